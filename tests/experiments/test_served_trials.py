"""Visual servoing through a served station's messages, and a camera that fails."""

import numpy as np
import pytest

from drake_srg.common.safety_states import SafetyState
from drake_srg.experiments.served_trials import ServedTrial, grasp_served
from drake_srg.experiments.servo_trials import Case, grasp_scenario
from drake_srg.lifetime import my_context
from drake_srg.planning.servoing.config import ServoFault
from drake_srg.types import Failure, Mode

pytestmark = pytest.mark.slow

LATE = 0.1  # s
_FEW = 6  # images of the hand's camera, before it fails


def test_a_moving_can_is_grasped_and_the_same_again():
    first = grasp_served(Case(0.05), "pbvs", 1, LATE)
    assert first.held
    assert first.error < 3e-3
    assert first.stopped == ""
    assert grasp_served(Case(0.05), "pbvs", 1, LATE) == first


@pytest.mark.parametrize(
    ("broken", "fault"),
    [("silent", ServoFault.SILENT), ("frozen", ServoFault.FROZEN)],
)
def test_a_camera_that_fails_on_the_wire_stops_the_hand_and_is_told(broken, fault):
    scenario = grasp_scenario(Case(0.05), "pbvs", 2, ["arm.limits=null"])
    trial = ServedTrial(scenario, LATE)
    cell = trial.loop._cell
    context = my_context(cell, trial.loop._root)
    servo, sent = (
        cell.GetOutputPort(name)
        for name in ("planner.servo_status", "arm.position_allowed")
    )
    faults, rests = set(), []
    while trial.loop.status.mode is not Mode.FAILED:
        assert trial.robot.time < 12.0
        trial.advance()
        assert trial.loop.safety[0] is SafetyState.RUNNING
        seen = servo.Eval(context)
        if seen.images >= _FEW:
            trial.robot.pictures.fault = broken
        if seen.fault is not None:
            faults.add(seen.fault)
            rests += [sent.Eval(context).copy()] if seen.at_rest else []
    assert faults == {fault}
    np.testing.assert_allclose(rests[0], rests[-1], atol=1e-3)
    assert trial.loop.status.failure is Failure.NOT_SEEN
    assert fault.value in trial.loop.status.message
    assert trial.told == []
