"""The plots of a report, as SVG, and the format of its numbers."""

from __future__ import annotations

import dataclasses as dc
import html
import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from drake_srg.sweeps.report.trials import Bin
from drake_srg.types import Vector


def percent(share: float, trials: int) -> str:
    """Return a share as a percentage, precise enough to show a single trial."""
    digits = max(1, math.ceil(math.log10(max(trials, 1))) - 2)
    return f"{100.0 * share:.{digits}f} %"


def quantile(values: Vector, share: float) -> float | None:
    """Return a quantile of the finite values, or None if there are none."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    # A value that occurred, not the mean of two.
    return float(np.quantile(finite, share, method="inverted_cdf"))


def number(value: float | None, unit: str = "") -> str:
    """Return a number with three digits and its unit; `-` if it is not finite."""
    if value is None or not math.isfinite(value):
        return "-"
    digits = f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
    return f"{digits} {unit}".rstrip()


# Size and margins of all plots in SVG units; the page scales plots to its columns.
_WIDTH, _HEIGHT = 320.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 42.0, 12.0, 22.0, 26.0
_BINS = 24  # of a histogram, each about 11 units wide
_NONE: Vector = np.empty(0)
_LETTER = 6.5  # mean width of a letter


def _tag(tag: str, text: str = "", /, **attributes: str | float) -> str:
    """Return an element of SVG.

    Args:
        tag: Name of the element.
        text: Its text.
        attributes: In names, `_` becomes `-`; a final `_`, as in `class_`, is dropped.
            Numbers are written with five digits.
    """
    words = [tag]
    for key, value in attributes.items():
        written = html.escape(value) if isinstance(value, str) else f"{value:.5g}"
        words.append(f'{key.rstrip("_").replace("_", "-")}="{written}"')
    return f"<{' '.join(words)}>{html.escape(text, quote=False)}</{tag}>"


@dc.dataclass(frozen=True)
class Scale:
    """Maps an interval of data to an interval of a plot."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """Return the coordinate of a value."""
        share = (value - self.low) / (self.high - self.low or 1.0)
        return self.start + share * (self.end - self.start)


def ticks(low: float, high: float, count: int) -> list[float]:
    """Return about `count` round values inside an interval."""
    if not high > low:
        return [low]
    rough = (high - low) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= 0.7 * rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * i for i in range(first, last + 1)]


def histogram(
    values: Vector, success: npt.NDArray[np.bool_], *, label: str, whole: bool = False
) -> str:
    """Return the distribution of a metric, failed trials on top of the others.

    The axis covers the successful trials, and their median and 95 % quantile are
    marked. A separate bar counts failed trials beyond the axis.

    Args:
        values: Shape (n,), nan where a trial has no value.
        success: Shape (n,).
        label: Description of the plot, for screen readers.
        whole: Whether the values are whole numbers, which have one bar each.
    """
    shown = np.isfinite(values)
    axis = values[shown & success] if np.any(shown & success) else values[shown]
    low, high = float(values[shown].min()), float(axis.max())
    if whole:
        edges = np.arange(low - 0.5, values[shown].max() + 1.0)
    else:
        margin = 1e-3 * (high - low) or 0.05 * abs(high) or 1.0  # if all are equal
        edges = np.linspace(low - margin, high + margin, _BINS + 1)
    counts = [
        np.histogram(values[shown & rows], edges)[0] for rows in (success, ~success)
    ]
    beyond = int(np.count_nonzero(values[shown] > edges[-1]))
    end = _WIDTH - _RIGHT - (26.0 if beyond else 0.0)
    x = Scale(edges[0], edges[-1], _LEFT, end)
    y = Scale(0.0, max(*(counts[0] + counts[1]), beyond), _HEIGHT - _BOTTOM, _TOP)
    children = _y_axis(y, ticks(0.0, y.high, 3), _count)
    at = ticks(edges[0], edges[-1], 7)
    children += _x_axis(x, [t for t in at if not whole or t == round(t)])
    for i, (good, bad) in enumerate(zip(*counts, strict=True)):
        left, right = x(edges[i]), x(edges[i + 1])
        children += _stack(y, left, right - left, int(good), int(bad))
    if beyond:
        children += _stack(y, _WIDTH - _RIGHT - 14.0, 14.0, 0, beyond)
        children.append(_text(_WIDTH - _RIGHT - 7.0, _HEIGHT - 10.0, "beyond"))
    return _svg(children + _quantile_marks(x, axis), label)


def _quantile_marks(x: Scale, values: Vector) -> list[str]:
    """Return lines at median and 95 % quantile, with labels that do not overlap."""
    marks: list[str] = []
    named = -math.inf
    for share, name in ((0.5, "median"), (0.95, "95 %")):
        at = x(quantile(values, share) or 0.0)
        marks.append(
            _tag(
                "line", x1=at, x2=at, y1=_TOP - 6.0, y2=_HEIGHT - _BOTTOM, class_="mark"
            )
        )
        middle = max(at, named + 6.0 * _LETTER)
        middle = min(max(middle, _LEFT + 18.0), _WIDTH - _RIGHT - 12.0)
        marks.append(_text(middle, _TOP - 10.0, name))
        named = middle
    return marks


def against(
    bins: Sequence[Bin],
    *,
    axis: tuple[float, float],
    text: Callable[[float], str],
    label: str,
    strokes: Vector = _NONE,
) -> str:
    """Return a plot of an outcome against a quantity.

    Args:
        bins: At least one, in order of the quantity.
        axis: Lowest and highest outcome that the plot shows.
        text: Formats a number on the outcome's axis.
        label: Description of the plot, for screen readers.
        strokes: Values of the quantity to mark at the bottom.
    """
    low, high = bins[0].low, bins[-1].high
    margin = 0.03 * (high - low) or 1.0
    x = Scale(low - margin, high + margin, _LEFT, _WIDTH - _RIGHT)
    foot = _HEIGHT - _BOTTOM
    y = Scale(*axis, foot - 12.0, 10.0)
    children = _y_axis(y, ticks(*axis, 4), text)
    whole = all(b.low == b.high == round(b.low) for b in bins)
    children += _x_axis(x, [b.low for b in bins] if whole else ticks(low, high, 5))
    for value in strokes:
        at = x(float(value))
        children.append(
            _tag("line", x1=at, x2=at, y1=foot - 9.0, y2=foot, class_="fail")
        )
    for b in bins:
        at, outcome = x(b.middle), y(b.outcome)
        top, bottom = y(b.bounds[1]), y(b.bounds[0])
        ends = x(b.low), x(b.high)
        children += [
            _tag("line", x1=at, x2=at, y1=bottom, y2=top, class_="bar"),
            _tag("line", x1=ends[0], x2=ends[1], y1=outcome, y2=outcome, class_="bin"),
            _tag("circle", cx=at, cy=outcome, r=3.0, class_="rate"),
        ]
    return _svg(children, label)


def _count(value: float) -> str:
    """Return a whole number as text, and nothing for any other number."""
    return f"{value:,.0f}" if value == round(value) else ""


def _svg(children: Sequence[str], label: str) -> str:
    return (
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="{html.escape(label)}">'
        f"{_tag('title', label)}{''.join(children)}</svg>"
    )


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return _tag("text", text, x=x, y=y, text_anchor=anchor)


def _stack(y: Scale, left: float, width: float, good: int, bad: int) -> list[str]:
    """Return a bar of successful trials with the failed ones on top."""
    gap = min(1.0, 0.1 * width)
    return [
        _tag(
            "rect",
            x=left + gap / 2.0,
            width=width - gap,
            y=y(top),
            # Even one trial in a thousand must be visible.
            height=max(y(bottom) - y(top), 1.5),
            class_=kind,
        )
        for kind, bottom, top in (("good", 0, good), ("bad", good, good + bad))
        if top > bottom
    ]


def _y_axis(
    y: Scale, values: Sequence[float], text: Callable[[float], str]
) -> list[str]:
    return [
        made
        for value in values
        for made in (
            _tag(
                "line",
                x1=_LEFT,
                x2=_WIDTH - _RIGHT,
                y1=y(value),
                y2=y(value),
                class_="grid",
            ),
            _text(_LEFT - 5.0, y(value) + 3.5, text(value), "end"),
        )
    ]


def _x_axis(x: Scale, values: Sequence[float]) -> list[str]:
    foot = _HEIGHT - _BOTTOM
    made = [_tag("line", x1=_LEFT, x2=x.end, y1=foot, y2=foot, class_="axis")]
    free = -math.inf  # where the next label may begin
    for value in values:
        at, text = x(value), f"{value:.6g}"
        made.append(_tag("line", x1=at, x2=at, y1=foot, y2=foot + 4.0, class_="axis"))
        half = len(text) * _LETTER / 2.0
        if at - half >= free:
            made.append(_text(at, _HEIGHT - 10.0, text))
            free = at + half + _LETTER
    return made
