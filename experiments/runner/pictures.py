"""The standard pictures of experiments: panels that draw trials or rows."""

from __future__ import annotations

import dataclasses as dc
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from drake_srg.recording.timeline import COLORS, style_axes
from drake_srg.types import Vector
from experiments.runner.claims import Row, Trials

_STYLES, _MARKERS = ("-", "--", ":", "-."), "os^v"
_STYLED = ("", " (dashed)", " (dotted)", " (dash-dotted)")  # behind a measure
_LETTERS = 30  # of 6.5 points, over the width of an image
# Draws one part of a picture: `draw` on axes, `by` being the axes that name a group of
# trials; `height` is how high it should be [inch].
Panel: TypeAlias = "Bars | Curves | Points | Histogram | Images"


@dc.dataclass(frozen=True)
class Bars:
    """A bar of each row, with its limit and, of a share, its interval."""

    quantities: Sequence[str]  # of the rows: of one unit, in a colour each
    names: Sequence[str] | None = None  # of the rows; None: all
    log: bool = False  # whether the values' axis is logarithmic

    def _rows(self, rows: Sequence[Row]) -> list[Row]:
        own = [row for row in rows if row.quantity in self.quantities]
        return [row for row in own if self.names is None or row.name in self.names]

    def height(self, trials: Trials, rows: Sequence[Row]) -> float:
        return min(1.4 + 0.2 * len(self._rows(rows)), 9.0)

    def draw(
        self, axes: Any, trials: Trials, rows: Sequence[Row], by: Sequence[str]
    ) -> None:
        drawn = self._rows(rows)
        names = list(dict.fromkeys(row.name for row in drawn))
        found = {(row.name, row.quantity): row.measured for row in rows}
        unit = next((f" [{row.unit}]" for row in drawn if row.unit), "")
        words = f"{' / '.join(self.quantities)}{unit}"
        style_axes(axes, xlabel=textwrap.fill(words, 36))
        wide = 0.8 / len(self.quantities)
        for row in drawn:
            i = list(self.quantities).index(row.quantity)
            what = row.quantity.removesuffix(", share")
            y = -names.index(row.name) + 0.4 - (i + 0.5) * wide
            axes.barh(y, row.measured, 0.9 * wide, color=COLORS[i % len(COLORS)])
            if len(self.quantities) > 1:
                axes.plot([], [], "s", color=COLORS[i % len(COLORS)], label=what)
            if row.judged:
                first, *others = row.expected.split()
                limit = float(others[0] if first in ("<=", ">=") else first)
                axes.plot([limit] * 2, [y - wide / 2, y + wide / 2], "k-", lw=1.5)
            ends = [found.get((row.name, f"{what}, at {w}")) for w in ("least", "most")]
            if None not in ends:
                axes.plot(ends, [y, y], "-", color="k", lw=1.0)
        axes.set_yticks([-k for k in range(len(names))], names, fontsize=7)
        axes.grid(axis="x", color="#c8ced6", lw=0.5)
        axes.set_axisbelow(True)
        if all(row.quantity.endswith(", share") for row in drawn):
            axes.set_xlim(0.0, 1.02)
        if self.log:
            axes.set_xscale("log")
        else:
            axes.locator_params(axis="x", nbins=6)


def bars_of(rows: Sequence[Row]) -> list[Panel]:
    """Return panels of judged quantities, at most six; of any if none is judged."""
    judged = [row for row in rows if row.judged] or rows
    return [Bars([q]) for q in list(dict.fromkeys(r.quantity for r in judged))[:6]]


@dc.dataclass(frozen=True, kw_only=True)
class _Plot:
    """A plot of measures."""

    where: dict[str, Any] = dc.field(default_factory=dict)  # chooses trials
    # Axes that name a colour, with units for the legend; by default, those of groups.
    label: Sequence[str] = ()
    limit: float | None = None  # drawn across
    log: str = ""  # which axes are logarithmic: `x`, `y` or `xy`
    title: str = ""

    def height(self, trials: Trials, rows: Sequence[Row]) -> float:
        return 3.2

    def _groups(
        self, trials: Trials, by: Sequence[str]
    ) -> Iterator[tuple[str, str, int, Trials]]:
        """Yield name, colour, how often that was used before, and trials of groups.

        A name has the same colour in all panels if the colours suffice.
        """
        named = [axis.partition(" [")[0] for axis in self.label or by]
        groups = trials.where(**self.where).groups(*named)
        every = Trials([t for t in trials if set(named) <= set(t)]).groups(*named)
        names = list(every if len(every) <= len(COLORS) else groups)
        for name, own in groups.items():
            i = names.index(name)
            yield name, COLORS[i % len(COLORS)], i // len(COLORS), own

    def _finish(self, axes: Any, vertical: bool = False) -> None:
        if self.limit is not None:
            line = axes.axvline if vertical else axes.axhline
            line(self.limit, color="k", ls="--", lw=0.8)
        if "x" in self.log:
            axes.set_xscale("log")
        if "y" in self.log:
            axes.set_yscale("log")
        axes.set_title(self.title, fontsize=9, loc="left")


@dc.dataclass(frozen=True)
class Curves(_Plot):
    """A curve of each trial, of measures that are arrays; names are labels."""

    x: str
    y: str | Sequence[str]  # in a style each
    reference: str = ""  # a measure that is drawn once, dashed

    def draw(
        self, axes: Any, trials: Trials, rows: Sequence[Row], by: Sequence[str]
    ) -> None:
        measures = [self.y] if isinstance(self.y, str) else list(self.y)
        words = ",\n".join(m + _STYLED[k % 4] for k, m in enumerate(measures))
        style_axes(axes, xlabel=self.x, ylabel=words)
        for name, color, before, own in self._groups(trials, by):
            for entry in own:
                for k, measure in enumerate(measures, before):
                    x, y = _floats(entry[self.x]), _floats(entry[measure])
                    style, shown = _STYLES[k % 4], name if k == before else None
                    axes.plot(x, y, style, color=color, lw=1.2, label=shown)
        for entry in trials.where(**self.where)[:1] if self.reference else ():
            x, y = _floats(entry[self.x]), _floats(entry[self.reference])
            axes.plot(x, y, "k--", lw=0.8, label=self.reference)
        self._finish(axes)


@dc.dataclass(frozen=True)
class Points(_Plot):
    """A point for each trial, or for each value of its arrays."""

    x: str  # measure or axis; its name is the label
    y: str
    equal: bool = False  # whether x = y is drawn: one is the reference of the other

    def draw(
        self, axes: Any, trials: Trials, rows: Sequence[Row], by: Sequence[str]
    ) -> None:
        style_axes(axes, xlabel=self.x, ylabel=self.y)
        for name, color, before, own in self._groups(trials, by):
            x, y = _values(own, self.x), _values(own, self.y)
            axes.plot(
                x, y, _MARKERS[before % 4], ms=4, alpha=0.7, color=color, label=name
            )
        if self.equal:
            middle = np.nanmean(_values(trials.where(**self.where), self.x))
            axes.axline((middle, middle), slope=1.0, color="k", ls="--", lw=0.8)
        self._finish(axes)


@dc.dataclass(frozen=True)
class Histogram(_Plot):
    """The distribution, in groups, of a measure: a number or an array per trial."""

    measure: str

    def draw(
        self, axes: Any, trials: Trials, rows: Sequence[Row], by: Sequence[str]
    ) -> None:
        style_axes(axes, xlabel=self.measure, ylabel="trials")
        every = np.append(_values(trials.where(**self.where), self.measure), 0.0)
        edges = np.linspace(np.nanmin(every), np.nanmax(every) + 1e-9, 31)
        for name, color, _, own in self._groups(trials, by):
            values = _values(own, self.measure)
            axes.hist(values, edges, histtype="step", color=color, label=name)
        self._finish(axes, vertical=True)


@dc.dataclass(frozen=True)
class Images:
    """A grid of images, one a trial, framed green, or red where a row of it fails."""

    image: str = "image"  # measure: an array (H, W, 3) of uint8
    caption: Callable[[Any], str] = lambda entry: ""  # of a trial, below
    across: int = 6  # images beside each other

    def height(self, trials: Trials, rows: Sequence[Row]) -> float:
        return 2.3 * -(-len(trials) // self.across)

    def draw(
        self, axes: Any, trials: Trials, rows: Sequence[Row], by: Sequence[str]
    ) -> None:
        """Draw on axes, which images replace."""
        axes.set_axis_off()
        failed = {row.name for row in rows if row.fails}
        across, down = self.across, -(-len(trials) // self.across)
        axes.figure.set_size_inches(1.8 * across, 0.4 + 2.3 * down)
        for i, entry in enumerate(trials):
            name = ", ".join(str(entry[axis]) for axis in by)
            x, y = i % across / across, 1.0 - (i // across + 1) / down
            own = axes.inset_axes([x, y + 0.06 / down, 0.95 / across, 0.82 / down])
            own.imshow(np.asarray(entry[self.image]), interpolation="none")
            own.set(xticks=[], yticks=[])
            own.spines[:].set(color=COLORS[1 if name in failed else 2], lw=2.0)
            above, below = name.replace("_", " "), self.caption(entry)
            style: dict[str, Any] = {"fontsize": 6.5, "loc": "left"}
            own.set_title(textwrap.fill(above, _LETTERS), pad=3, **style)
            own.set_xlabel(textwrap.fill(below, _LETTERS), **style)


def draw_legends(figure: Any, labels: Mapping[Any, Sequence[str]]) -> None:
    """Add legends beside the data: one below the figure if all panels agree.

    A legend of one entry, or of more than twelve, is left out. One with numbers names
    the axes that they belong to, which are in `labels` by panel.
    """
    found = {}
    for axes in figure.get_axes():
        handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        if 1 < len(handles) <= 12:
            found[axes] = handles
    style: dict[str, Any] = {"fontsize": 7, "title_fontsize": 7, "frameon": False}
    if len({tuple(handles) for handles in found.values()}) == 1:
        axes, handles = next(iter(found.items()))
        style["title"] = _legend_title(handles, labels[axes])
        wide = 0.5 + 0.06 * max(map(len, handles))  # of a name in 7 points [inch]
        columns = max(1, int(figure.get_figwidth() / wide))
        place = {"loc": "outside lower center", "ncols": columns}
        figure.legend(handles.values(), handles.keys(), **place, **style)
        return
    for axes, handles in found.items():
        place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
        style["title"] = _legend_title(handles, labels[axes])
        axes.legend(handles.values(), handles.keys(), **place, **style)


def _legend_title(names: Iterable[str], axes: Sequence[str]) -> str:
    parts = [part for name in names for part in name.split(", ")]
    number = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?")
    return ", ".join(axes) if any(map(number.fullmatch, parts)) else ""


def _floats(value: Any) -> Any:
    return np.array(np.nan if value is None else value, dtype=float)


def _values(own: Trials, measure: str) -> Vector:
    """Return a measure's values of all trials; None is NaN."""
    if not len(own):
        return np.zeros(0)
    return np.concatenate([np.atleast_1d(_floats(t[measure])) for t in own])
