import dataclasses as dc

import pytest

from drake_srg.common.exceptions import ScenarioError
from measure import hardware_loop
from measure.hardware_loop import CASES, check_speed, judge
from measure.served_runs import ServedRun

GOOD = ServedRun(True, True, "", 1.0e-3, 0.0, 7.0, 0.1)
TOLD = ServedRun(False, False, "stale", 0.2, 0.0, 0.0, 0.1)
CLEAN, FAULTY = "kitchen, ROS 2", "5 % lost"


def failed(rows):
    return {row.quantity for row in rows if not row.passed}


def test_a_clean_wire_places_every_object():
    assert not failed(judge(CLEAN, [GOOD, GOOD], 0.6e-3))
    assert failed(judge(CLEAN, [GOOD, TOLD], 0.6e-3)) == {"placed, of 2"}


def test_a_faulty_one_may_stop_and_say_why():
    assert not failed(judge(FAULTY, [GOOD, TOLD], None))
    silent = dc.replace(TOLD, told="")
    assert failed(judge(FAULTY, [silent], None)) == {"neither placed nor told why"}


@pytest.mark.parametrize("name", [CLEAN, FAULTY])
def test_nothing_may_be_claimed_that_is_not_so(name):
    wrong = dc.replace(TOLD, claimed=True)
    assert "claimed, but not placed" in failed(judge(name, [wrong], 0.6e-3))


def test_errors_are_judged_by_those_in_one_process():
    what = "largest placement error in x or y"
    assert failed(judge(CLEAN, [GOOD], 0.4e-3)) == {what}
    assert not failed(judge(CLEAN, [dc.replace(GOOD, rounding=0.3e-3)], 0.4e-3))


def test_a_machine_that_is_too_slow_is_told_before_the_runs():
    case = CASES[CLEAN]
    check_speed(case, 1.0, 1.0)
    check_speed(case, 0.5, 0.5)
    message = r"^kitchen: runs at 0.79 x real time .* a rate of 0.5, .* `rate`$"
    with pytest.raises(ScenarioError, match=message):
        check_speed(case, 0.79, 1.0)


def test_an_unknown_case_is_named():
    assert CLEAN in CASES
    with pytest.raises(ScenarioError, match="unknown case 'kitchen, ROS 3'"):
        hardware_loop.run(lambda items, label: items, cases=["kitchen, ROS 3"])
