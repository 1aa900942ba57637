"""Makes the generated blocks of docs/experiments.md from rows and stamps."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.row import Row
from reproduce.stamps import Stamp


def update(
    page: str, name: str, description: str, rows: Sequence[Row], stamp: Stamp
) -> str:
    """Return the page with the block of an experiment replaced.

    An experiment that the page does not have yet gets a section at its end.

    Raises:
        ScenarioError: If the section lacks its markers, or has several pairs.
    """
    if f"\n## {name}\n" not in page:
        page += (
            f"\n## {name}\n\n{description}\n"
            f"\n![{description}](experiments/{name}.png)\n"
            f"\n<!-- {name}: generated -->\n<!-- end -->\n"
        )
    page, count = re.subn(
        rf"(<!-- {name}: generated -->\n).*?(<!-- end -->)",
        lambda match: match[1] + block(rows, stamp) + match[2],
        page,
        flags=re.DOTALL,
    )
    if count != 1:
        raise ScenarioError(
            f"experiments.md: {name}: needs one pair of markers, got {count}"
        )
    return page


def block(rows: Sequence[Row], stamp: Stamp) -> str:
    """Return the rows as a Markdown table, folded below a summary."""
    missed = [row for row in rows if not row.passed]
    summary = (
        f"{len(rows) - len(missed)} of {len(rows)} rows pass "
        f"(Drake {stamp.drake}, {show_time(stamp.seconds)})"
    )
    cells = [
        ("name", "quantity", "measured", "spread", "unit", "expected", "pass"),
        ("---",) * 7,
        *(
            (
                row.name,
                row.quantity,
                f"{row.measured:.4g}" if math.isfinite(row.measured) else "-",
                f"{row.spread:.2g}",
                row.unit,
                row.expected,
                "yes" if row.passed else f"**no**{row.known and ': '}{row.known}",
            )
            for row in rows
        ),
    ]
    text = "\n".join(f"| {' | '.join(line)} |" for line in cells)
    unfolded = " open" if missed else ""
    return f"<details{unfolded}><summary>{summary}</summary>\n\n{text}\n\n</details>\n"


def show_time(seconds: float) -> str:
    """Return a duration for people, such as `8 s` or `12 min`."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
