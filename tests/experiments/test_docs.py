"""docs/experiments.md shows every experiment."""

import re
import sys
from pathlib import Path

import pytest

from drake_srg.experiments.registry import list_experiments, list_measurements

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "experiments.md").read_text()
ROWS = [
    {
        "name": "base",
        "quantity": "drift",
        "expected": "<= 3",
        "measured": measured,
        "unit": "um/s",
        "pass": passed,
    }
    for measured, passed in ((1.23456, True), (None, False))
]


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import update_experiment_docs

    yield update_experiment_docs
    del sys.modules["update_experiment_docs"]


@pytest.mark.parametrize("name", [*list_experiments(), *list_measurements()])
def test_the_page_shows_every_experiment_with_its_rows(name):
    assert f"\n## {name}\n" in PAGE
    assert f"(experiments/{name}.png)" in PAGE
    (rows,) = re.findall(rf"<!-- {name}: generated -->(.*?)<!-- end -->", PAGE, re.S)
    assert "rows pass" in rows


def test_figures_exist_and_are_small():
    figures = re.findall(r"\((experiments/[^)]+)\)", PAGE)
    assert figures
    for figure in figures:
        assert (ROOT / "docs" / figure).stat().st_size < 100_000, figure


def test_new_rows_replace_the_old_ones(tool):
    page = (
        "# Page\n\n## fake\n\nWords.\n\n<!-- fake: generated -->\nold\n<!-- end -->\n"
    )
    updated = tool.update(page, "fake", "Fake.", ROWS)
    assert "old" not in updated
    assert "Words." in updated
    assert "1 of 2 rows pass" in updated
    assert "| base | drift | 1.235 | um/s | <= 3 | yes |" in updated
    assert "| base | drift | - | um/s | <= 3 | **no** |" in updated
    assert tool.update(updated, "fake", "Fake.", ROWS) == updated


def test_a_new_experiment_gets_a_section(tool):
    page = tool.update("# Page\n", "fake", "Fake.", ROWS)
    assert "\n## fake\n\nFake.\n\n![Fake.](experiments/fake.png)\n" in page
    assert tool.update(page, "fake", "Fake.", ROWS) == page


def test_a_missing_marker_is_reported(tool):
    with pytest.raises(SystemExit, match="fake: needs one pair of markers"):
        tool.update("# Page\n\n## fake\n\n", "fake", "Fake.", ROWS)
