import numpy as np
import pytest

from drake_srg.simulation.hand_poses import hand_poses
from drake_srg.simulation.rig import Rig, bench_scenario


@pytest.mark.slow
@pytest.mark.parametrize("rpy", [(0.0, 90.0, 0.0), (0.0, 0.0, 30.0)])
def test_logged_arm_states_give_the_poses_of_the_palm(rpy):
    scenario = bench_scenario(gripper_rpy=rpy, home=[0.1, -0.2, 0.5])
    palms = []
    with Rig(scenario, log_period=0.05) as rig:
        palms.append(rig.X_WG())
        for _ in range(3):
            rig.move(rig.commanded("arm.position_commanded") + 0.01, 0.05)
            palms.append(rig.X_WG())
        states = rig.log()["arm.state_measured"]
    assert not palms[0].IsNearlyEqualTo(palms[-1], 1e-3)
    for X_WG, expected in zip(hand_poses(scenario, states), palms, strict=True):
        assert X_WG.IsNearlyEqualTo(expected, 1e-9)


def test_no_states_give_no_poses():
    assert hand_poses(bench_scenario(), np.zeros((0, 6))) == []
