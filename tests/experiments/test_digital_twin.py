import dataclasses as dc

import pytest

from drake_srg.experiments.digital_twin import FAULTS, Beside, beside, judge
from drake_srg.robot.twin.loop import Parting
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode

PARTING = Parting(2.5, "finger", 0.2, 0.1, "")
GOOD = Beside(Mode.DONE, 7.0, 1.5, [], [0.01, 0.001, 0.02, 0.002])


def passed(name, *runs):
    return [row.quantity for row in judge(name, runs) if not row.passed]


def test_a_healthy_robot_must_be_done_without_reports():
    assert passed("healthy", GOOD, GOOD) == []
    assert passed("healthy", GOOD, dc.replace(GOOD, partings=[PARTING])) == [
        "false reports"
    ]
    failed = dc.replace(GOOD, ended=Mode.FAILED)
    assert passed("healthy", GOOD, failed) == ["done, of 2 runs"]


def test_every_fault_must_be_reported():
    told = dc.replace(GOOD, partings=[PARTING])
    assert passed("no friction", told) == []
    (after,) = (r for r in judge("no friction", [told]) if "after" in r.quantity)
    assert after.measured == pytest.approx(1.0)
    assert passed("no friction", told, GOOD) == ["reported, of 2 runs"]


def test_a_robot_and_its_twin_agree_while_the_arm_moves():
    run = beside("kitchen_fast", FAULTS["healthy"], 0, longest=1.5)
    assert run.ended in (Mode.PRE_GRASP, Mode.GRASP)
    assert run.partings == []
    joint, _, finger, thing = run.largest
    assert joint < load_scenario("kitchen_fast").twin.joint
    assert finger < 0.1
    assert thing < 0.01
