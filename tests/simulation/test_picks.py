"""What each grasp took, from made-up logs."""

import pytest

from drake_srg.simulation.clearing import clearing_outcome
from drake_srg.types import Mode, PlannerStatus
from simulation.test_clearing import ON_TABLE, A, B, log, scenario

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
