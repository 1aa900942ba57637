"""Pages made from the committed results: those of the experiments, and quoted figures.

README.md and docs/figures.md quote results in text that is read in the repository, too.
Their text between two markers is that of a template, with its values filled in.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from experiments import FOLDER, find_experiments
from experiments.runner.claims import Row
from experiments.runner.committed import (
    COMMITTED,
    Stamp,
    committed_rows,
    read_stamps,
    show_time,
)
from experiments.runner.sources import ROOT, code_of

# Pages that quote results, by their templates in data/.
QUOTING = {"readme.md": ROOT / "README.md", "figures.md": ROOT / "docs/figures.md"}
_BLOCK = re.compile("(?<=<!-- figures -->\n).*(?=<!-- end of figures -->\n)", re.DOTALL)
_OLD = "†"  # behind figures whose experiment runs other code since
_VALUE = re.compile(r"\{(\w+)\|([^|}]+)\|([^|}]+)\|([^}]+)\}")


def pages() -> dict[str, str]:
    """Return the page of each experiment by its name, as Markdown."""
    stamps = read_stamps()
    return {
        name: page(name, found.module, found.description, stamps.get(name))
        for name, found in find_experiments().items()
    }


def page(name: str, module: str, description: str, stamp: Stamp | None) -> str:
    """Return the page of an experiment: why, command, picture, verdict and rows."""
    file = f"{module.replace('.', '/')}.py"
    source = (FOLDER.parent / file).read_text(encoding="utf-8")
    _, _, why = (ast.get_docstring(ast.parse(source)) or "").partition("\n\n")
    why = f"{why}\n\n```sh\ndrake-srg experiment {name}  # {file}\n```\n"
    text = f"# {name}\n\n{description}\n\n"
    rows = committed_rows(name)
    if rows is None or stamp is None:
        return f"{text}{why}\nNo result is committed yet.\n"
    picture = f"![{description}]({name}.png)\n\n"
    picture *= (COMMITTED / f"{name}.png").is_file()
    missed = [row for row in rows if not row.passed]
    judged = [row for row in rows if row.judged]
    others = [row for row in rows if not row.judged]
    text += f"**{verdict(name, rows, stamp)}** Drake {stamp.drake}, "
    text += f"{show_time(stamp.seconds)}.\n\n{picture}{why}\n"
    if missed:
        text += "## What falls short\n\n"
        text += "".join(
            f"* {row.name}, {row.quantity}: {number(row.measured)} {row.unit} "
            f"({row.expected}). {row.known}\n"
            for row in missed
        )
        text += "\n"
    if judged:
        text += f"## Claims\n\n{table(judged)}\n"
    return text + (f"## Other figures\n\n{table(others)}\n" if others else "")


def stale(name: str, stamp: Stamp) -> bool:
    """Return whether the code of an experiment has changed since."""
    return stamp.sources != code_of(name)


def verdict(name: str, rows: Sequence[Row], stamp: Stamp) -> str:
    """Return how many claims hold, and whether that is still known."""
    judged = [row.passed for row in rows if row.judged]
    text = f"{sum(judged)} of {len(judged)} claims hold."
    if not judged:
        text = f"{len(rows)} figures."
    return f"{text} Not run since the code changed." if stale(name, stamp) else text


def table(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table; those without a criterion lack its column."""
    judged = any(row.judged for row in rows)
    head = ["name", "quantity", "measured", "spread", "unit"]
    lines = [head + ["expected", "source", "holds"] * judged]
    lines.append(["---"] * len(lines[0]))
    for row in rows:
        cells = [row.name, row.quantity, number(row.measured), f"{row.spread:.2g}"]
        holds = "yes" if row.passed else "**no**"
        lines.append([*cells, row.unit, *([row.expected, row.source, holds] * judged)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def number(value: float) -> str:
    """Return a value for people; `-` for none."""
    return f"{value:.4g}" if math.isfinite(value) else "-"


def read_claims() -> list[dict[str, Any]]:
    """Return what is claimed, by whom, where it is tried and what is ours."""
    text = (FOLDER / "data/claims.yaml").read_text(encoding="utf-8")
    keys = ("claim", "source", "experiments", "ours")
    claims = [dict(zip(keys, line, strict=True)) for line in yaml.safe_load(text)]
    return [{**claim, "ours": fill(claim["ours"])} for claim in claims]


def fill(text: str, folder: Path = COMMITTED) -> str:
    """Return a text with `{EXPERIMENT|ROW|QUANTITY|FORMAT}` replaced by values.

    A row `*` stands for the least value of all rows of that quantity.

    Raises:
        KeyError: If a row that is quoted does not exist.
    """

    def value(match: re.Match[str]) -> str:
        experiment, name, quantity, form = match.groups()
        values = [
            row.measured
            for row in committed_rows(experiment, folder) or ()
            if row.quantity == quantity and name in (row.name, "*")
        ]
        if not values:
            raise KeyError(f"{experiment}: no row {name!r}, {quantity!r}")
        text = format(min(values) if name == "*" else values[0], form)
        return text.replace("%", " %")

    return _VALUE.sub(value, text)


def quoting_pages() -> dict[Path, str]:
    """Return the required text of each page that quotes results.

    Lines with figures of code that has changed since are marked.
    """
    stamps, texts = read_stamps(), {}
    old = {name for name, stamp in stamps.items() if stale(name, stamp)}

    def filled(line: str) -> str:
        quoted = {match.group(1) for match in _VALUE.finditer(line)}
        text, cell = fill(line), " |" * line.endswith(" |")
        return f"{text.removesuffix(cell)} {_OLD}{cell}" if quoted & old else text

    for template, page in QUOTING.items():
        lines = (FOLDER / "data" / template).read_text(encoding="utf-8").splitlines()
        block = "".join(f"{filled(line)}\n" for line in lines)
        text = page.read_text(encoding="utf-8")
        texts[page] = _BLOCK.sub(block.replace("\\", r"\\"), text)
    return texts


def write_quoting_pages() -> None:
    """Fill the committed values into the pages that quote them."""
    for page, text in quoting_pages().items():
        if page.read_text(encoding="utf-8") != text:  # others may be reading it
            page.write_text(text, encoding="utf-8")


def claims_table() -> str:
    """Return the table of claims: what, by whom, ours and the verdict."""
    stamps = read_stamps()
    lines = ["| claim | by | ours | experiment |", "|---|---|---|---|"]
    for entry in read_claims():
        links = ", ".join(link(name, stamps) for name in entry["experiments"])
        cells = (entry["claim"], entry["source"], entry["ours"], links)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def link(name: str, stamps: dict[str, Stamp]) -> str:
    """Return a link to an experiment's page, with its verdict in short."""
    rows, stamp = committed_rows(name), stamps.get(name)
    if rows is None or stamp is None:
        return f"[{name}](experiments/{name}.md) (no result)"
    judged = [row.passed for row in rows if row.judged]
    since = ", not run since" * stale(name, stamp)
    return f"[{name}](experiments/{name}.md) ({sum(judged)}/{len(judged)}{since})"


def index() -> str:
    """Return the table of claims, and all other experiments in a list."""
    stamps, claimed = read_stamps(), read_claims()
    shown = {name for entry in claimed for name in entry["experiments"]}
    others = [
        f"* {link(name, stamps)}: {found.description}"
        for name, found in find_experiments().items()
        if name not in shown
    ]
    pages = "```{toctree}\n:hidden:\n:glob:\n\nexperiments/*\n```\n"
    own = "\n".join(others)
    return f"{claims_table()}\nClaims of our own:\n\n{own}\n\n{pages}"
