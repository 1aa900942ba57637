"""How the arm comes to a grasp, with the scenario's own arm and bin."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.cell.clearing import MakeClearingPlanner
from drake_srg.planning.grasps.top_grasp import palm_pose
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode
from planning.clearing.fake_table import grasp_at, moved, table

PLACE = (0.55, 0.05)


@pytest.fixture(scope="module")
def motions():
    scenario = load_scenario("clear_table", overrides=["clutter.count=1"])
    return MakeClearingPlanner(scenario).planner.motions


@pytest.mark.parametrize(
    ("place", "yaw"),
    [((0.55, 0.07), -0.6), ((0.55, 0.35), -0.17), ((0.45, 0.35), -0.17)],
)
def test_the_arm_faces_the_grasp(motions, place, yaw):
    turned = RigidTransform(palm_pose(np.array([*place, 0.2]), yaw))
    grasp = dc.replace(grasp_at(place), X_WG=turned)
    planned = motions.plan(motions.q_home, grasp, moved(table()))
    assert not isinstance(planned, PlanningFailure), planned.message
    q = planned[Mode.GRASP].value(1e9)[:, 0]
    # Bent backwards, its first joint would be turned by pi.
    assert q[0] == pytest.approx(np.arctan2(place[1], place[0]), abs=1.0)


def test_motions_follow_one_another(motions):
    planned = motions.plan(motions.q_home, grasp_at(PLACE), moved(table()))
    order = (Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.TRANSFER)
    q = motions.q_home
    for mode in order:
        np.testing.assert_allclose(planned[mode].value(0.0)[:, 0], q, atol=1e-6)
        q = planned[mode].value(1e9)[:, 0]
