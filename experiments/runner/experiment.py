"""An experiment: a grid of cases, a trial of each, claims, and a picture."""

from __future__ import annotations

import collections.abc
import contextlib
import dataclasses as dc
import inspect
import itertools
import re
import textwrap
import typing
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from drake_srg.common.exceptions import ScenarioError, suggest
from experiments.runner.claims import (
    Case,
    Claim,
    Measures,
    Row,
    Trials,
    Values,
    rows_of,
)
from experiments.runner.pictures import Bars, Panel, bars_of, draw_legends

# What parameters are, unless the docstring of `cases` says it.
_PARAMETERS = {
    "trials": "Trials of each case.",
    "seeds": "Trials of each case, a seed each.",
    "seed": "Of the first trial.",
    "objects": "Names of the objects; all by default.",
    "cases": "Names of the cases; all by default.",
    "engines": "Names of the engines; all by default.",
}
# Draws on an empty figure.
Drawing: TypeAlias = Callable[[Any, Trials, Sequence[Row]], None]


def grid(**axes: Iterable[Any]) -> list[dict[str, Any]]:
    """Return every combination of values, the last axis fastest."""
    values = itertools.product(*axes.values())
    return [dict(zip(axes, combination, strict=True)) for combination in values]


def chosen(key: str, names: Sequence[str], known: Collection[str]) -> Collection[str]:
    """Return the given names, or all known names if there are none.

    Raises:
        ScenarioError: If a name is unknown; it names the parameter.
    """
    for name in names:
        if name not in known:
            raise ScenarioError(f"{key}: unknown {name!r} {suggest(name, known)}")
    return names or known


@dc.dataclass(frozen=True)
class Experiment:
    """An experiment; its name is that of the module's variable that holds it.

    Whatever changes the result of a trial must be in its case: finished trials are kept
    by their cases.

    Attributes:
        description: One line.
        cases: Returns the cases. Its keyword arguments are the parameters that `--set`
            changes; its `Args:` describe them, but for `trials`, `seed` and the like.
        trial: Returns the measures of a case, passed as keyword arguments: numbers,
            text, None, arrays, images (arrays of uint8), lists and mappings of them.
        claims: Claims by quantity.
        by: The axes that name a group of trials, joined by commas; the first one by
            default.
        summary: Returns the values of a group, see `rows_of`; by default, those of its
            only trial.
        whole: Returns values of all trials by the name of their rows.
        picture: Panels of the picture, or a function that draws; by default, bars of
            the quantities that are judged.
        preset: Values that this experiment gives to parameters.
        serial: Whether to run one trial at a time because they measure wall-clock time.
        files: Returns text of other files of the result, by name.
    """

    description: str
    cases: Callable[..., Iterable[Case]]
    trial: Callable[..., Measures]
    claims: Mapping[str, Claim] = dc.field(default_factory=dict)
    by: Sequence[str] = ()
    summary: Callable[[Trials], Values] | None = None
    whole: Callable[[Trials], Mapping[str, Values]] | None = None
    picture: Sequence[Panel] | Drawing = ()
    preset: Mapping[str, Any] = dc.field(default_factory=dict)
    serial: bool = False
    files: Callable[[Trials], Mapping[str, str]] | None = None

    def judge(self, trials: Trials, partial: bool = False) -> list[Row]:
        """Return the rows of trials; `partial` ones lack those of missing cases.

        Raises:
            ValueError: If there are no rows.
        """
        missing = (LookupError, ValueError, TypeError) if partial else ()
        rows: list[Row] = []
        for name, own in trials.groups(*self.axes(trials)).items():
            with contextlib.suppress(*missing):
                only = own[0] if len(own) == 1 else {}
                values = self.summary(own) if self.summary else only
                rows += rows_of(name, values, self.claims, own)
        with contextlib.suppress(*missing):
            for name, values in (self.whole(trials) if self.whole else {}).items():
                rows += rows_of(name, values, self.claims, trials)
        if not (rows or partial):
            raise ValueError("the trials give no rows")
        return rows

    def axes(self, trials: Trials) -> Sequence[str]:
        """Return the axes that name a group."""
        return self.by or tuple(trials[0])[:1]

    def draw(self, figure: Any, trials: Trials, rows: Sequence[Row]) -> None:
        """Draw the picture below the description."""
        if callable(self.picture):
            self.picture(figure, trials, rows)
        else:
            self._draw_panels(figure, self.picture, trials, rows)
        # The title of 10 points has at most 14 letters per inch.
        title = textwrap.fill(self.description, int(14 * figure.get_figwidth()))
        figure.suptitle(title, x=0.01, ha="left", weight="bold", fontsize=10)

    def _draw_panels(
        self, figure: Any, panels: Sequence[Panel], trials: Trials, rows: Sequence[Row]
    ) -> None:
        panels = panels or bars_of(rows)
        wide = min(len(panels), 3)
        high = -(-len(panels) // wide)
        height = max(panel.height(trials, rows) for panel in panels)
        figure.set_size_inches(max(6.0, 4.4 * wide), 0.6 + height * high)
        left: Any = None  # the first axes of the line
        labels: dict[Any, Sequence[str]] = {}
        for i, panel in enumerate(panels):
            axes = figure.add_subplot(high, wide, i + 1)
            left = left if i % wide else axes
            panel.draw(axes, trials, rows, self.axes(trials))
            labels[axes] = getattr(panel, "label", ()) or self.axes(trials)
            named = isinstance(panel, Bars) and axes is not left
            if named and _labels(axes) == _labels(left):
                axes.tick_params(labelleft=False)
        draw_legends(figure, labels)

    def parameters(self) -> dict[str, tuple[Any, str]]:
        """Return default and description of each parameter."""
        described = re.findall(
            r"^ {4}(\w+): (.*(?:\n {8}.*)*)",
            inspect.getdoc(self.cases) or "",
            re.MULTILINE,
        )
        texts = {name: " ".join(text.split()) for name, text in described}
        found = inspect.signature(self.cases).parameters.values()
        return {
            p.name: (
                self.preset.get(p.name, p.default),
                texts.get(p.name) or _PARAMETERS.get(p.name, ""),
            )
            for p in found
        }

    def values(self, name: str, overrides: Iterable[str]) -> dict[str, Any]:
        """Return the parameters' values, checked by their type hints.

        Numbers must be positive: they are counts, times, masses, forces and the like.

        Raises:
            ScenarioError: If an override does not fit; it names the experiment.
        """
        allowed = self.parameters()
        hints = typing.get_type_hints(self.cases)
        values = dict(self.preset)
        for override in overrides:
            key, equals, text = override.partition("=")
            if not (key and equals):
                raise ScenarioError(f"--set {override}: must be KEY=VALUE")
            if not allowed:
                raise ScenarioError(
                    f"experiment {name}: takes no parameters, got {key!r}"
                )
            if key not in allowed:
                hint = suggest(key, allowed)
                raise ScenarioError(f"experiment {name}: unknown key {key!r} {hint}")
            values[key] = _parse(text, hints[key], f"experiment {name}", key)
        return values


def _labels(axes: Any) -> list[str]:
    """Return the names of bars, if the panel has any."""
    return [label.get_text() for label in axes.get_yticklabels()]


def _parse(text: str, hint: Any, origin: str, key: str) -> Any:
    from drake_srg.scenario.typed_yaml import check_tree, fail, parse_yaml

    value = parse_yaml(f"value: {text}", f"--set {key}")["value"]
    if typing.get_origin(hint) is typing.Literal:
        allowed = typing.get_args(hint)
        if value not in allowed:
            fail(origin, key, f"must be one of {', '.join(allowed)}; got {value!r}")
        return value
    many = typing.get_origin(hint) is collections.abc.Sequence
    # Made from the hint, which mypy does not follow.
    # A type that is made at run time, of which mypy knows nothing.
    schema = list[typing.get_args(hint)] if many else hint  # type: ignore[misc]
    value = check_tree(value, schema, origin, key)
    items = value if many else [value]
    if not items:
        fail(origin, key, "needs at least one entry")
    for item in items:
        if isinstance(item, (int, float)) and not item > 0:
            fail(origin, key, f"must be greater than 0, got {item}")
    return tuple(items) if many else value
