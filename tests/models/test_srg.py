"""The SRG: joints, pad gap, frames and contact between its links."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, Role
from pydrake.systems.analysis import Simulator

from models.built_models import Built, Distances, build, moduli, path_of

SRG_JOINTS = (
    "left_base_joint",
    "right_base_joint",
    "left_tip_joint",
    "right_tip_joint",
)


def test_joints_and_actuators_are_in_the_documented_order():
    plant = build("srg").plant
    joints = [
        plant.get_joint(j).name()
        for j in plant.GetJointIndices()
        if plant.get_joint(j).num_positions() == 1
    ]
    actuators = [
        plant.get_joint_actuator(a).name() for a in plant.GetJointActuatorIndices()
    ]
    assert tuple(joints) == SRG_JOINTS
    assert tuple(actuators) == SRG_JOINTS


@pytest.mark.parametrize("name", SRG_JOINTS)
def test_joint_limits(name):
    plant = build("srg").plant
    joint = plant.GetJointByName(name)
    actuator = plant.GetJointActuatorByName(name)
    assert joint.position_lower_limits() == pytest.approx([0])
    assert joint.position_upper_limits() == pytest.approx([1.94])
    assert joint.velocity_upper_limits() == pytest.approx([3.67])
    # Two wires share 4.69 N m on a spool of 7.6 mm; moment arms of 6.5 and 4.63 mm.
    effort = 2.006 if "base" in name else 1.428
    assert actuator.effort_limit() == pytest.approx(effort, rel=1e-3)
    ratio = actuator.default_gear_ratio()
    arm = effort / (800 / 1023 * 6.0 / 0.0076 / 2)
    assert ratio == pytest.approx(200 * arm / 0.0076, rel=1e-3)


@pytest.mark.parametrize(
    ("degrees", "gap"), [(0, 0.182), (45, 0.133), (90, 0.0416), (100.7, 0.0009)]
)
def test_pad_gap_by_base_angle(degrees, gap):
    built = build("srg")
    built.set_joints(**dict.fromkeys(SRG_JOINTS, 0.0))
    angle = np.radians(degrees)
    built.set_joints(left_base_joint=angle, right_base_joint=angle)
    left, right = (pad_corners(built, side) for side in ("left", "right"))
    assert left[:, 1].min() - right[:, 1].max() == pytest.approx(gap, abs=5e-4)
    np.testing.assert_allclose(
        sorted(map(tuple, np.round(left, 9))),
        sorted(map(tuple, np.round(right * (1, -1, 1), 9))),
        atol=1e-8,
    )


def pad_corners(built: Built, side: str) -> np.ndarray:
    body = built.plant.GetBodyByName(f"{side}_tip_link")
    shapes = built.shapes(body, Role.kProximity)
    ((shape, X_BG),) = [(s, X) for name, s, X in shapes if name.endswith(f"{side}_pad")]
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    X_WB = built.plant.EvalBodyPoseInWorld(built.plant_context, body)
    return ((X_WB @ X_BG) @ (signs * shape.size() / 2).T).T


def test_frames():
    built = build("srg")
    built.set_joints(**dict.fromkeys(SRG_JOINTS, 0.0))
    built.set_joints(left_base_joint=np.pi / 2, right_base_joint=np.pi / 2)
    pads = np.vstack([pad_corners(built, side) for side in ("left", "right")])
    frames = {
        name: built.plant.GetFrameByName(name).CalcPoseInWorld(built.plant_context)
        for name in ("mount", "grasp_center")
    }
    assert frames["mount"].IsExactlyIdentity()
    x, y, z = frames["grasp_center"].translation()
    assert (y, z) == (0, 0)
    assert pads[:, 0].min() + 0.01 < x < pads[:, 0].max() - 0.01
    assert frames["grasp_center"].rotation().IsExactlyIdentity()


def sweep(count: int) -> Iterator[tuple[float, float]]:
    for base in np.linspace(0, 1.94, count):
        for tip in np.linspace(0, 1.94, count):
            yield base, tip


def test_only_opposite_fingers_touch_each_other():
    built = Built("srg")
    for base, tip in sweep(13):
        built.set_joints(left_base_joint=base, right_base_joint=base)
        built.set_joints(left_tip_joint=tip, right_tip_joint=tip)
        for one, other in built.touching():
            assert {one[:4], other[:4]} == {"left", "righ"}, (base, tip)


def test_opposite_pads_touch():
    built = Built("srg")
    built.set_joints(left_base_joint=1.8, right_base_joint=1.8)
    assert ("left_tip_link", "right_tip_link") in built.touching()


@pytest.mark.parametrize("side", ("left", "right"))
def test_one_finger_moves_freely_even_without_collision_filters(side):
    built = Built("srg")
    names = ["palm", f"{side}_base_link", f"{side}_tip_link"]
    frames = [
        built.plant.GetBodyFrameIdOrThrow(built.plant.GetBodyByName(n).index())
        for n in names
    ]
    manager = built.scene_graph.collision_filter_manager(
        built.scene_graph.GetMyMutableContextFromRoot(built.context)
    )
    manager.Apply(CollisionFilterDeclaration().AllowWithin(GeometrySet(frames)))
    for base, tip in sweep(21):
        built.set_joints(**{f"{side}_base_joint": base, f"{side}_tip_joint": tip})
        own = {pair for pair in built.touching() if set(pair) <= set(names)}
        assert not own, (base, tip)


def test_gripper_closes_until_its_pads_meet():
    built = Built("srg")
    port = built.plant.get_actuation_input_port()
    # A fraction of full effort.
    port.FixValue(built.plant_context, [0.2, 0.2, 0.02, 0.02])
    simulator = Simulator(built.diagram, built.context)
    simulator.AdvanceTo(1.5)
    q = built.plant.GetPositions(built.plant_context)
    v = built.plant.GetVelocities(built.plant_context)
    assert np.all(np.abs(v) < 0.05)
    assert np.all(q > -0.01) and np.all(q < 1.95)
    assert ("left_tip_link", "right_tip_link") in built.touching()
    left, right = (pad_corners(built, side) for side in ("left", "right"))
    # Compliant pads press into each other, by less than a millimetre.
    assert -1e-3 < left[:, 1].min() - right[:, 1].max() < 1e-4


def test_only_the_pads_are_soft():
    for (_, name), modulus in moduli(build("srg")).items():
        assert modulus == (2e6 if name.endswith("_pad") else np.inf), name


def test_srg_fast_has_the_surfaces_that_hold_an_object():
    """The base link's face, the palm's face and the noses."""
    built, fast = build("srg"), build("srg_fast")
    for name, points in {
        "left_base_link": [(x, 0.0092, z) for x in (0.007, 0.037) for z in (0, 0.014)],
        "palm": [(0.072, y, z) for y in (0.0, 0.018) for z in (0, 0.015)],
        "left_tip_link": [(0.0, 0.0086, z) for z in (-0.008, 0.0, 0.008)],
    }.items():
        for model in (built, fast):
            body = model.plant.GetBodyByName(name)
            distances = Distances(model.shapes(body, Role.kProximity))
            for p in points:
                distance = min(distances.at(np.array(p)).values())
                assert abs(distance) < 4e-4, (name, p)


def test_srg_fast_differs_from_srg_only_in_collision_geometry():
    built, fast = build("srg"), build("srg_fast")
    for body in built.bodies():
        other = fast.plant.GetBodyByName(body.name())
        one, two = (
            b.CalcSpatialInertiaInBodyFrame(m.plant_context).CopyToFullMatrix6()
            for m, b in ((built, body), (fast, other))
        )
        np.testing.assert_array_equal(one, two)
        seen = [
            [path_of(shape).name for _, shape, _ in m.shapes(b, Role.kIllustration)]
            for m, b in ((built, body), (fast, other))
        ]
        assert seen[0] == seen[1]
