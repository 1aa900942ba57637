import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.row import Row
from reproduce.page import block, show_time, update
from tools.reproduce.made_rows import STAMP

ROWS = [Row.at_most("base", "drift", 3.0, v, "um/s") for v in (1.23456, math.nan)]


def test_new_rows_replace_the_old_ones():
    page = (
        "# Page\n\n## fake\n\nWords.\n\n<!-- fake: generated -->\nold\n<!-- end -->\n"
    )
    updated = update(page, "fake", "Fake.", ROWS, STAMP)
    assert "old" not in updated
    assert "Words." in updated
    assert "1 of 2 rows pass (Drake 1.2.3, 8 s)" in updated
    assert "| base | drift | 1.235 | 0.3 | um/s | <= 3 | yes |" in updated
    assert "| base | drift | - | 0.3 | um/s | <= 3 | **no** |" in updated
    assert update(updated, "fake", "Fake.", ROWS, STAMP) == updated


def test_a_known_reason_stands_beside_the_row():
    row = Row.at_most("base", "drift", 3.0, 4.0, "um/s").because("soft pads")
    text = block([row], STAMP)
    assert "0 of 1 rows pass" in text
    assert "| <= 3 | **no**: soft pads |" in text


def test_a_new_experiment_gets_a_section():
    page = update("# Page\n", "fake", "Fake.", ROWS, STAMP)
    assert "\n## fake\n\nFake.\n\n![Fake.](experiments/fake.png)\n" in page
    assert update(page, "fake", "Fake.", ROWS, STAMP) == page


def test_sections_do_not_disturb_each_other():
    page = update("# Page\n", "one", "One.", ROWS, STAMP)
    page = update(page, "two", "Two.", ROWS[:1], STAMP)
    assert update(page, "one", "One.", ROWS, STAMP) == page
    assert page.count("rows pass") == 2


@pytest.mark.parametrize("count", [0, 2])
def test_markers_must_come_as_one_pair(count):
    page = "\n## fake\n\n" + count * "<!-- fake: generated -->\n<!-- end -->\n"
    with pytest.raises(ScenarioError, match=f"fake: needs one pair .*, got {count}"):
        update(page, "fake", "Fake.", ROWS, STAMP)


def test_rows_are_unfolded_where_one_fails():
    assert "<details open>" in block(ROWS, STAMP)
    assert "<details>" in block(ROWS[:1], STAMP)


@given(seconds=st.floats(0.0, 1e5))
def test_durations_have_a_unit_that_suits_them(seconds):
    number, unit = show_time(seconds).split()
    assert float(number) * {"s": 1.0, "min": 60.0}[unit] == pytest.approx(
        seconds, abs=0.5 if unit == "s" else 30.0
    )
