import dataclasses as dc

from made import rows

from experiments.runner.claims import row
from experiments.runner.rerun import Report


def report(old, new, **values):
    made = dc.replace(Report(), **values)
    made.add("fake", old, new)
    return made


def test_equal_figures_are_good():
    made = report(rows(), rows())
    assert made.good
    assert "1 of 1 experiments ran; 0 rows changed" in made.text()
    assert "ACCEPT" not in made.text()


def test_a_moved_figure_is_shown_with_its_spread():
    made = report(rows(1.0), rows(1.5))
    assert not made.good
    line = next(line for line in made.text().splitlines() if "slip" in line)
    assert line.split() == ["fake", "can", "slip", "1", "1.5", "0.3", "mm", "moved"]
    assert dc.replace(made, accepted=True).good


def test_a_failing_row_is_not_good_even_where_it_is_accepted():
    made = report(rows(5.0), rows(5.0))
    assert "failed: <= 3" in made.text()
    assert not made.good
    assert not dc.replace(made, accepted=True).good


def test_an_experiment_that_did_not_run_does_not_look_like_success():
    made = report(rows(), rows(), missing={"bridge": "needs a roscore"})
    assert "bridge: NOT RUN: needs a roscore" in made.text()
    assert "1 of 2 experiments ran" in made.text()
    assert not made.good
    assert not dc.replace(made, accepted=True).good


def test_a_first_result_wants_to_be_accepted():
    made = report(None, rows())
    assert "fake: no committed result yet" in made.text()
    assert not made.good
    accepted = dc.replace(made, accepted=True)
    assert accepted.good
    assert "no committed result yet" not in accepted.text()


def test_the_machine_s_speed_is_told_where_it_matters():
    assert "2.00 times as long" in report(rows(), rows(wall=4.0)).text()
    timeless = [row("can", "slip", 1.0, "mm")]
    assert "times as long" not in report(timeless, timeless).text()
