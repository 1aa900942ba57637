import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.cell.goals import final_pose, final_tilt, goal_pose
from drake_srg.objects.config import ColorRangeConfig
from drake_srg.planning.script.scripted import Script, ScriptStep
from drake_srg.planning.task.sightings import lean, standing_at
from drake_srg.scenario import load_scenario
from drake_srg.types import Cylinder, Sphere

KITCHEN = load_scenario("kitchen", seed=0)
MUG = dc.replace(
    KITCHEN.objects["soup_can"],
    model="package://drake_srg/sdf/mug.sdf",
    color_range=ColorRangeConfig(),
)
CAN = Cylinder(0.0339, 0.1018)
START = RigidTransform([0.6, 0.1, 0.0509])


def with_task(**changes):
    return dc.replace(KITCHEN, task=dc.replace(KITCHEN.task, **changes))


def test_the_goal_is_on_the_table_unless_a_height_is_given():
    x, y = KITCHEN.task.place.position
    p = goal_pose(KITCHEN, CAN).translation()
    np.testing.assert_allclose(p, [x, y, 0.0509])
    place = dc.replace(KITCHEN.task.place, height=-0.005)
    p = goal_pose(with_task(place=place), CAN).translation()
    np.testing.assert_allclose(p, [x, y, 0.0459])


@pytest.mark.parametrize("repeat", [1, 2, 3, 4])
def test_every_second_cycle_returns_the_object(repeat):
    final = final_pose(with_task(repeat=repeat), START).translation()
    place = [*KITCHEN.task.place.position, 0.0509]
    there = START.translation() if repeat % 2 == 0 else place
    np.testing.assert_allclose(final, there, atol=1e-4)


def test_a_script_keeps_height_and_orientation():
    lying = RigidTransform(RollPitchYaw(0.5, 1.0, 0.2), [0.6, 0.1, 0.3])
    scripted = dc.replace(KITCHEN, planner=Script(steps=[ScriptStep()]))
    final = final_pose(scripted, lying)
    np.testing.assert_allclose(final.translation(), [*KITCHEN.task.place.position, 0.3])
    np.testing.assert_array_equal(final.rotation().matrix(), lying.rotation().matrix())


@pytest.mark.parametrize(("repeat", "height"), [(1, None), (2, None), (1, 0.1)])
def test_what_is_no_simple_shape_stays_as_it_stood(repeat, height):
    mug = MUG
    place = dc.replace(KITCHEN.task.place, height=height)
    scenario = dc.replace(
        with_task(place=place, repeat=repeat), objects={"soup_can": mug}
    )
    start = RigidTransform(RollPitchYaw(0.0, 0.0, 0.2), [0.6, 0.1, 0.0])
    final = final_pose(scenario, start)
    there = [*place.position, height or 0.0]
    expected = start.translation() if repeat == 2 else there
    np.testing.assert_allclose(final.translation(), expected, atol=1e-4)
    np.testing.assert_array_equal(final.rotation().matrix(), start.rotation().matrix())


def test_what_lies_may_be_turned_about_the_vertical_but_not_tilted():
    scenario = dc.replace(KITCHEN, objects={"soup_can": MUG})
    lying = RollPitchYaw(1.5, 0.0, 0.2).ToRotationMatrix()
    start = RigidTransform(lying, [0.6, 0.1, 0.04])
    for roll, yaw in ((0.0, 0.8), (0.1, 0.0)):
        end = RigidTransform(RollPitchYaw(roll, 0.0, yaw).ToRotationMatrix() @ lying)
        assert final_tilt(scenario, start, end) == pytest.approx(roll, abs=1e-9)


def test_a_ball_has_no_tilt():
    ball = dc.replace(KITCHEN.objects["soup_can"], model=None, shape=Sphere(0.03))
    scenario = dc.replace(KITCHEN, objects={"soup_can": ball})
    assert final_tilt(scenario, START, START) is None


@given(
    roll=st.floats(-np.pi, np.pi),
    pitch=st.floats(-1.5, 1.5),
    radius=st.floats(0.01, 0.05),
    length=st.floats(0.02, 0.2),
)
def test_righting_an_object_keeps_its_lowest_point(roll, pitch, radius, length):
    shape = Cylinder(radius, length)
    X_WO = RigidTransform(RollPitchYaw(roll, pitch, 0.0), [0.1, 0.2, 0.3])
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    # Sampled on the rims.
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle])
    ends = [rim + np.array([[0.0], [0.0], [s * length / 2]]) for s in (-1, 1)]
    lowest = min((X_WO @ end)[2].min() for end in ends)
    stands = standing_at(X_WO, shape)
    # Halfway between samples, the rim is up to 1e-5 of its radius lower.
    assert stands.translation()[2] - length / 2 == pytest.approx(lowest, abs=1e-6)
    np.testing.assert_array_equal(stands.translation()[:2], [0.1, 0.2])
    assert lean(stands.rotation().col(2), np.array([0.0, 0.0, 1.0])) == 0.0
