import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import grasping
from drake_srg.experiments.data import household_objects
from drake_srg.experiments.grasping import (
    GraspConfig,
    Support,
    present,
    rest_height,
    simulate,
    width_between_pads,
)
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Cylinder, Sphere

angles = st.tuples(*[st.floats(-180.0, 180.0)] * 3).map(np.deg2rad)
sizes = st.tuples(*[st.floats(0.001, 0.3)] * 3)


@given(sizes, angles)
def test_a_box_rests_on_its_lowest_corner(size, rpy):
    R = RollPitchYaw(rpy).ToRotationMatrix()
    corners = [
        R.matrix() @ (0.5 * np.array(size) * signs)
        for signs in np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3)
    ]
    height = rest_height(ObjectConfig(shape=Box(list(size))), R)
    assert height == pytest.approx(-min(corner[2] for corner in corners))


@given(sizes, angles)
def test_a_cylinder_rests_on_its_lowest_point(size, rpy):
    radius, length, _ = size
    R = RollPitchYaw(rpy).ToRotationMatrix()
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    ends = [np.stack([x, y, 0.0 * x + z]) for z in (-length / 2, length / 2)]
    height = rest_height(ObjectConfig(shape=Cylinder(radius, length)), R)
    lowest = min(np.min((R.matrix() @ end)[2]) for end in ends)
    # The points are up to a quarter of a degree from the lowest one.
    assert height == pytest.approx(-lowest, abs=1e-5 * radius)


@given(st.floats(0.001, 0.3), angles)
def test_a_ball_is_as_wide_as_it_is_high(radius, rpy):
    ball = ObjectConfig(shape=Sphere(radius))
    grasp = GraspConfig(object=list(np.rad2deg(rpy)))
    R = RollPitchYaw(rpy).ToRotationMatrix()
    assert rest_height(ball, R) == pytest.approx(radius, rel=1e-12)
    assert width_between_pads(ball, grasp) == pytest.approx(2.0 * radius)


@pytest.mark.parametrize(
    ("hand", "thing", "width"),
    [
        ([0, 0, 0], [0, 0, 0], 0.2),
        ([0, 90, 0], [0, 0, 90], 0.1),
        ([90, 0, 0], [0, 0, 0], 0.3),
        ([0, 0, 0], [90, 0, 0], 0.3),
        ([0, 90, 90], [0, 0, 0], 0.1),
    ],
)
def test_the_width_is_measured_across_the_pads(hand, thing, width):
    box = ObjectConfig(shape=Box([0.1, 0.2, 0.3]))
    grasp = GraspConfig(hand=hand, object=thing)
    assert width_between_pads(box, grasp) == pytest.approx(width)


def test_models_stand_upright_and_have_no_known_width():
    mug = household_objects()["mug"]
    upright = RollPitchYaw(0.0, 0.0, 1.0).ToRotationMatrix()
    assert rest_height(mug, upright) == 0.0
    assert np.isnan(width_between_pads(mug, GraspConfig()))
    with pytest.raises(ValueError, match="must stand upright"):
        rest_height(mug, RollPitchYaw(0.1, 0.0, 0.0).ToRotationMatrix())


@pytest.mark.slow
@pytest.mark.parametrize("hand", [[0, 90, 0], [0, 0, 0], [90, 0, 0], [-90, 64, 180]])
def test_the_hand_arrives_with_the_object_where_the_grasp_says(hand):
    grasp = GraspConfig(
        hand=hand,
        grip=[0.16, 0.01, -0.02],
        height=0.2,
        supports=[Support(size=[0.1, 0.1, 0.2], at=[0.01, 0.02])],
    )
    bench = present(household_objects()["056_tennis_ball"], grasp)
    bench.arm.home = [
        *(np.array(bench.arm.home) - grasp.R_WG @ np.array(grasp.retreat))
    ]
    rig = Rig(bench)
    np.testing.assert_allclose(rig.X_GO().translation(), grasp.grip, atol=1e-9)
    support = rig.X_WO("support_0").translation()
    np.testing.assert_allclose(support, [0.51, 0.02, 0.1], atol=1e-9)


WRAPPED = GraspConfig(grip=[0.108, 0.0, 0.0])


def hurry(monkeypatch, shake):
    # Winding up a loose wire and pressing on the can takes 1.5 s.
    monkeypatch.setattr(grasping, "_ARRIVE", 0.5)
    monkeypatch.setattr(grasping, "_CLOSE", 2.0)
    monkeypatch.setattr(grasping, "SHAKE", shake)
    monkeypatch.setattr(grasping, "HELD", 3.0 * shake)


@pytest.mark.slow
def test_a_wrapped_can_is_held(monkeypatch):
    hurry(monkeypatch, shake=2.0)
    bench = present(household_objects()["005_tomato_soup_can"], WRAPPED)
    outcome = simulate(bench, WRAPPED)
    assert outcome.held_for == 6.0
    assert outcome.lifted == pytest.approx(grasping.LIFT_HEIGHT, abs=1e-3)
    assert outcome.acceleration == pytest.approx(9.81, rel=0.05)
    assert outcome.slip < 1e-3
    assert outcome.wire_force == pytest.approx(WRAPPED.wire_force, rel=0.05)


@pytest.mark.slow
def test_a_wrapped_can_without_friction_is_lost(monkeypatch):
    hurry(monkeypatch, shake=0.1)
    can = household_objects()["005_tomato_soup_can"]
    can.friction = 0.0
    outcome = simulate(present(can, WRAPPED), WRAPPED)
    assert outcome.held_for == 0.0
    assert outcome.lifted < 0.01


def test_a_grasp_that_the_gripper_cannot_make_is_reported():
    bench = present(household_objects()["056_tennis_ball"], WRAPPED)
    with pytest.raises(ScenarioError, match=r"the servo gives 0 \.\. 309 N"):
        simulate(bench, dc.replace(WRAPPED, wire_force=400.0))
    other = bench_scenario(overrides=["gripper=!SrgPositionDriver {}"])
    with pytest.raises(ScenarioError, match="needs !SrgTendonDriver"):
        simulate(other, WRAPPED)
