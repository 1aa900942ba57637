"""Elements of a page. What people or programs wrote stands in them escaped, always."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np

from drake_srg.types import Vector

Element = ElementTree.Element
Child = Element | str
Attribute = str | float
Item = TypeVar("Item")


def element(tag: str, /, *children: Child, **attributes: Attribute) -> Element:
    """Return an element of HTML or SVG.

    Args:
        tag: Its name.
        children: Elements and text, in their order.
        attributes: With `_` for `-`; one at the end, as in `class_`, is left out.
            Numbers have the five digits that matter to a drawing.
    """
    made = Element(
        tag,
        {
            key.rstrip("_").replace("_", "-"): value
            if isinstance(value, str)
            else f"{value:.5g}"
            for key, value in attributes.items()
        },
    )
    for child in children:
        if isinstance(child, Element):
            made.append(child)
        elif len(made):
            made[-1].tail = (made[-1].tail or "") + child
        else:
            made.text = (made.text or "") + child
    return made


def table(
    head: Sequence[Child], rows: Iterable[Sequence[Child]], label: str, class_: str = ""
) -> Element:
    """Return a table that scrolls by itself where the page is narrow."""
    return element(
        "div",
        element(
            "table",
            element(
                "thead",
                element("tr", *(element("th", cell, scope="col") for cell in head)),
            ),
            element(
                "tbody",
                *(
                    element("tr", *(element("td", cell) for cell in row))
                    for row in rows
                ),
            ),
            class_=class_,
        ),
        class_="scroll",
        role="region",
        tabindex="0",  # for those who scroll by keys
        aria_label=label,
    )


def section(title: str, *children: Child) -> Element:
    """Return a part of the page under its heading."""
    name = title.lower().replace(" ", "-")
    heading = element("h2", title, id=name)
    return element("section", heading, *children, aria_labelledby=name)


def paragraph(*children: Child) -> Element:
    """Return a paragraph of plain text."""
    return element("p", *children)


def folded(summary: str, *children: Child) -> Element:
    """Return what only shows when somebody asks for it, or prints the page."""
    return element("details", element("summary", summary), *children)


def definitions(rows: Sequence[tuple[str, Child]]) -> Element:
    """Return names with their values."""
    return element(
        "dl",
        *(
            element("div", element("dt", name), element("dd", value))
            for name, value in rows
        ),
    )


def in_part(
    items: Sequence[Item], opened: int, show: Callable[[Sequence[Item]], Element]
) -> list[Element]:
    """Show the first items, the others on request."""
    shown = [show(items[:opened])] if opened else []
    rest = items[opened:]
    if rest:
        shown.append(folded(f"{len(rest):,} more", show(rest)))
    return shown


def figure(
    name: str, words: str, plot: Element | None = None, class_: str = "words"
) -> Element:
    """Return a plot below its name and what it shows in words."""
    caption = element(
        "figcaption",
        element("strong", name),
        element("span", words, class_=class_),
    )
    return element("figure", caption, *([] if plot is None else [plot]))


def code(text: str) -> Element:
    """Return text as a command or a name in a program."""
    return element("code", text)


def percent(share: float, trials: int) -> str:
    """Return a share as text, fine enough for one trial of so many to show."""
    digits = max(1, math.ceil(math.log10(max(trials, 1))) - 2)
    return f"{100.0 * share:.{digits}f} %"


def quantile(values: Vector, share: float) -> float | None:
    """Return a quantile of the finite ones of values; None where there is none."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    # One that was seen, never a mean of two.
    return float(np.quantile(finite, share, method="inverted_cdf"))


def number(value: float | None, unit: str = "") -> str:
    """Return a number of three digits with its unit, `-` where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    digits = f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
    return f"{digits} {unit}".rstrip()
