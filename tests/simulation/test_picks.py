"""What each grasp took, from made-up logs."""

import pytest

from drake_srg.simulation.clearing import clearing_outcome
from drake_srg.simulation.picks import delivered
from drake_srg.types import Mode, PlannerStatus
from simulation.test_clearing import IN_BIN, ON_TABLE, A, B, log, scenario

__all__ = ["scenario"]  # a fixture


@pytest.mark.parametrize("rise", [0.05, 0.15])
@pytest.mark.parametrize("carried", [[], [A], [A, B]])
def test_what_one_grasp_has_carried_together_is_told(scenario, carried, rise):
    modes = [Mode.PRE_GRASP, Mode.CLOSE, Mode.CLOSE, Mode.TRANSFER, Mode.DONE]
    made = log(scenario, {A: ON_TABLE, B: ON_TABLE}, modes)
    for name in carried:
        made[f"object_pose.{name}"] = made[f"object_pose.{name}"].copy()
        made[f"object_pose.{name}"][3, 2] += rise
    status = PlannerStatus(mode=Mode.DONE, attempts=1, cycles=1, multi_object_picks=1)
    found = clearing_outcome(scenario, made, status)
    together = {A: B, B: A} if len(carried) == 2 and rise > 0.1 else {}
    told = {n: o.carried_with for n, o in found.objects.items() if o.carried_with}
    assert told == together
    assert found.metrics()["multi_object_picks"] == bool(together)
    assert found.metrics()["multi_object_picks_seen"] == 1


@pytest.mark.parametrize(
    ("loads", "cleared", "expected"),
    [
        ([], [A], 0),
        ([[A], [B]], [A, B], 2),
        ([[A], [B]], [B], 1),  # one fell beside the bin
        ([[A, B]], [A, B], 1),
        ([[A], [], [A]], [A], 1),  # it fell out, and was taken again
        ([[A, B], [B]], [A, B], 2),
    ],
)
def test_a_pick_delivers_what_rests_where_it_belongs(loads, cleared, expected):
    assert delivered(loads, cleared) == expected


def test_deliveries_are_told(scenario):
    modes = [Mode.PRE_GRASP, Mode.CLOSE, Mode.CLOSE, Mode.TRANSFER, *3 * [Mode.DONE]]
    made = log(scenario, {A: IN_BIN, B: ON_TABLE}, modes)
    pose = made[f"object_pose.{A}"] = made[f"object_pose.{A}"].copy()
    pose[:3, 2] -= 0.15
    status = PlannerStatus(mode=Mode.DONE, attempts=1)
    metrics = clearing_outcome(scenario, made, status).metrics()
    assert metrics["picks_delivered"] == 1
    assert metrics["picks_held"] == 0  # by the planner's word
