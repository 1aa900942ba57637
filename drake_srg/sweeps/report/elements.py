"""Elements of an HTML page; text from scenarios and trials is always escaped."""

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
        tag: Name of the element.
        children: Elements and text, in order.
        attributes: `_` becomes `-`, and a final one, as in `class_`, is dropped.
            Numbers are written with five digits, which is enough for a drawing.
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
    """Return a table, which scrolls on its own if the page is too narrow.

    Args:
        head: Titles of the columns.
        rows: Cells of each row.
        label: What the table contains, for screen readers.
        class_: CSS class of the table.
    """
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
        tabindex="0",  # allows scrolling with the keyboard
        aria_label=label,
    )


def section(title: str, *children: Child) -> Element:
    """Return a section of the page with its heading."""
    name = title.lower().replace(" ", "-")
    heading = element("h2", title, id=name)
    return element("section", heading, *children, aria_labelledby=name)


def paragraph(*children: Child) -> Element:
    """Return a paragraph of plain text."""
    return element("p", *children)


def folded(summary: str, *children: Child) -> Element:
    """Return content that is hidden until the reader opens it or prints the page."""
    return element("details", element("summary", summary), *children)


def definitions(rows: Sequence[tuple[str, Child]]) -> Element:
    """Return a list of names and their values."""
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
    """Return the first items, and the others folded away.

    Args:
        items: All items.
        opened: How many are not folded.
        show: Makes an element of some items.
    """
    shown = [show(items[:opened])] if opened else []
    rest = items[opened:]
    if rest:
        shown.append(folded(f"{len(rest):,} more", show(rest)))
    return shown


def figure(
    name: str, words: str, plot: Element | None = None, class_: str = "words"
) -> Element:
    """Return a plot below its name and a description of what it shows."""
    caption = element(
        "figcaption",
        element("strong", name),
        element("span", words, class_=class_),
    )
    return element("figure", caption, *([] if plot is None else [plot]))


def code(text: str) -> Element:
    """Return text in the font of commands and names."""
    return element("code", text)


def percent(share: float, trials: int) -> str:
    """Return a share as text, with enough digits to show one of so many trials."""
    digits = max(1, math.ceil(math.log10(max(trials, 1))) - 2)
    return f"{100.0 * share:.{digits}f} %"


def quantile(values: Vector, share: float) -> float | None:
    """Return a quantile of the finite values; None without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    # A value that occurred, never a mean of two.
    return float(np.quantile(finite, share, method="inverted_cdf"))


def number(value: float | None, unit: str = "") -> str:
    """Return a number with three digits and its unit; `-` if it is not finite."""
    if value is None or not math.isfinite(value):
        return "-"
    digits = f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
    return f"{digits} {unit}".rstrip()
