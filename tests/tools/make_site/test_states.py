"""The planners' states: drawings and tables have every transition."""

import pytest

from make_site.states import TABLES, condition_words, drawing, states_page


@pytest.mark.parametrize("name", TABLES)
def test_a_drawing_has_every_mode_and_an_arrow_for_each_pair(name):
    _, transitions = TABLES[name]
    picture = drawing(transitions)
    pairs = {(m, next_one) for m, leads in transitions.items() for _, next_one in leads}
    assert picture.count('class="arc"') == len(pairs)
    for mode in {mode for pair in pairs for mode in pair}:
        assert f">{mode.name}</text>" in picture


def test_the_page_has_a_row_for_every_transition():
    count = sum(len(leads) for _, table in TABLES.values() for leads in table.values())
    rows = [line for line in states_page().splitlines() if line.startswith("| `")]
    assert len(rows) == count
    assert "| `LIFT` | `RELEASE` | `arrived and (not holding)` |" in rows


def named_condition(o, t, c):
    return True


def test_a_condition_is_shown_by_its_source_or_its_name():
    assert condition_words(lambda o, t, c: o.ready and t >= c.wait) == (
        "ready and t >= wait"
    )
    assert condition_words(named_condition) == "named_condition"
