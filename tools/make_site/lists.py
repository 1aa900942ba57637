"""Tables of the package's scenarios and household objects."""

from __future__ import annotations

import re

from drake_srg.cli.commands import scenario_titles
from drake_srg.objects.household import HOUSEHOLD, household_object, object_facts
from make_site.markdown import code, page_title, table

_PAGE = re.compile(r"(?:[;,] see | \()docs/([\w/]+\.md)\)?")


def scenarios_table() -> str:
    """Return a row per scenario: name, first sentence, page."""
    rows = []
    for name, title in scenario_titles().items():
        page = _PAGE.search(title)
        link = f"[{page_title(page[1])}](../{page[1]})" if page else ""
        rows.append((code(name), _PAGE.sub("", title), link))
    return table(("scenario", "cell", "page"), rows)


def objects_table() -> str:
    """Return a row per household object: name, size, mass, number of pieces."""
    rows = []
    for name in HOUSEHOLD:
        facts = object_facts(name, household_object(name))
        size = " x ".join(f"{1e3 * side:.0f}" for side in facts.size)
        rows.append((code(name), size, f"{1e3 * facts.mass:.4g}", str(facts.pieces)))
    return table(("object", "size [mm]", "mass [g]", "pieces"), rows)
