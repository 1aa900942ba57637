"""Pieces of Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

_DOCS = Path(__file__).parents[2] / "docs"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table."""
    lines = [heads, ["---"] * len(heads), *([cell(text) for text in r] for r in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def cell(text: str) -> str:
    """Return text that fits into a cell of a table."""
    return " ".join(text.split()).replace("\\|", "|").replace("|", "\\|")


def code(text: str) -> str:
    """Return text as code."""
    return f"`{text}`"


def page_title(page: str) -> str:
    """Return the heading of a page, by its path below docs."""
    return (_DOCS / page).read_text("utf-8").split("\n")[0].removeprefix("# ")
