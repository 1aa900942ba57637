"""One grasp from beginning to end: present, close, lift, shake, measure."""

import copy
import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw, RotationMatrix

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario, shake
from drake_srg.types import Box, Vector

MIDDLE = np.array([0.5, 0.0, 0.0])  # origin of the gantry's joint positions [m]
# Times [s]. The hand arrives. The fingers close (up to 2.5 s with a loose wire) and the
# wire force settles (time constant 0.3 s). The arm lifts. Each shake has two cycles
# that swell, one at full strength and two that fade. Then everything comes to rest.
_ARRIVE, _CLOSE, _LIFT, SHAKE, _REST = 1.0, 3.5, 0.8, 2.5, 0.3
LIFT_HEIGHT = 0.1  # m
ACCELERATION, FREQUENCY = 9.81, 2.0  # m/s², Hz
HELD = 3.0 * SHAKE  # from the end of the lift to the end of the last shake [s]
# Steel [kg/m³], so heavy that no hand moves it.
_SUPPORT_DENSITY, _SUPPORT_COLOR = 7850.0, [0.45, 0.46, 0.48]
_PADS_X = 0.158  # middle of the pads of straight fingers, in the palm frame [m]
# An object is lost when it moves in the hand by more than the width of a pad [m].
_PAD_WIDTH = 0.03


@dc.dataclass(kw_only=True)
class Support:
    """A steel block on the bench."""

    # x, y, z [m].
    size: list[float] = dc.field(
        default_factory=lambda: [0.1, 0.1, 0.1], metadata={"length": 3}
    )
    # Position of its middle from the middle of the bench [m].
    at: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )


@dc.dataclass(kw_only=True)
class GraspConfig:
    """How an object is presented and how the hand grasps it."""

    # Roll, pitch, yaw of the palm [degrees]: [0, 0, 0] points to the front and closes
    # horizontally; [0, 90, 0] points down; [90, 0, 0] closes vertically.
    hand: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )
    # The object's origin in the palm frame when the fingers close [m].
    grip: list[float] = dc.field(
        default_factory=lambda: [0.15, 0.0, 0.0], metadata={"length": 3}
    )
    why: str = ""  # reason for this grasp
    # Roll, pitch, yaw of the object [degrees].
    object: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )
    # Height of the object's support [m].
    height: float = dc.field(default=0.0, metadata={"ge": 0.0})
    supports: list[Support] = dc.field(default_factory=list)
    # Start of the approach, in the palm frame, relative to the grasp [m].
    retreat: list[float] = dc.field(
        default_factory=lambda: [-0.12, 0.0, 0.0], metadata={"length": 3}
    )
    wire_force: float = dc.field(default=80.0, metadata={"ge": 0.0})  # per wire [N]

    @property
    def R_WG(self) -> RotationMatrix:
        """Orientation of the palm frame in world."""
        return RollPitchYaw(np.deg2rad(self.hand)).ToRotationMatrix()


@dc.dataclass(frozen=True)
class Outcome:
    """The outcome of a grasp.

    Attributes:
        held_for: Time after the lift during which only the gripper touches the object
            [s], at most HELD.
        lifted: Rise of the object during the lift [m].
        acceleration: Peak acceleration of the hand along the axis where the peak is
            lowest [m/s²].
        settled: Motion in the hand during the lift [m].
        sway: Largest motion in the hand during the shakes [m].
        slip: Motion in the hand that remains at the end [m].
        turn: Rotation in the hand that remains at the end [rad].
        grip_force: Sum of the normal forces on all finger links after the lift [N].
        wire_force: Largest force of either wire at any time [N].
        q: Positions of the plant at the end.
        p_WL: Middle between the pads at the end, in world, shape (3,) [m].
    """

    held_for: float
    lifted: float
    acceleration: float
    settled: float
    sway: float
    slip: float
    turn: float
    grip_force: float
    wire_force: float
    q: Vector
    p_WL: Vector


def _reach(thing: ObjectConfig, u_O: Vector) -> float:
    """Return the extent of a shape from its middle along a unit vector (3,) [m].

    NaN for a model that is not a single shape.
    """
    shape = simple_shape("thing", thing)
    return np.nan if shape is None else shape.half_extent(u_O)


def rest_height(thing: ObjectConfig, R_WO: RotationMatrix) -> float:
    """Return the height of an object's origin above its support [m].

    Raises:
        ValueError: If a model that stands on its x-y plane is tilted.
    """
    z_O = R_WO.matrix()[2]
    reach = _reach(thing, z_O)
    if np.isfinite(reach):
        return reach
    if not np.isclose(z_O[2], 1.0):
        raise ValueError("a model must stand upright")
    return 0.0


def width_between_pads(thing: ObjectConfig, grasp: GraspConfig) -> float:
    """Return an object's extent along the palm's y [m]; NaN for a compound model."""
    R_WO = RollPitchYaw(np.deg2rad(grasp.object)).ToRotationMatrix()
    return 2.0 * _reach(thing, R_WO.matrix().T @ grasp.R_WG.matrix()[:, 1])


def present(
    thing: ObjectConfig, grasp: GraspConfig, scenario: str = "gripper_bench"
) -> Scenario:
    """Return the bench with an object to grasp and the hand in front of it."""
    thing = copy.deepcopy(thing)
    rotation = RollPitchYaw(np.deg2rad(grasp.object))
    R_WO = rotation.ToRotationMatrix()
    p_WO = MIDDLE + np.array([0.0, 0.0, grasp.height + rest_height(thing, R_WO)])
    thing.pose = Transform()
    thing.pose.translation, thing.pose.rotation = p_WO, Rotation(rotation)
    p_WG = p_WO - grasp.R_WG @ np.array(grasp.grip) - MIDDLE
    bench = bench_scenario(
        thing,
        gripper_rpy=grasp.hand,
        home=list(p_WG + grasp.R_WG @ np.array(grasp.retreat)),
        scenario=scenario,
    )
    for i, support in enumerate(grasp.supports):
        bench.objects[f"support_{i}"] = ObjectConfig(
            shape=Box(support.size),
            mass=_SUPPORT_DENSITY * float(np.prod(support.size)),
            friction=0.6,
            color=_SUPPORT_COLOR,
            position=[MIDDLE[0] + support.at[0], support.at[1]],
        )
    return bench


def simulate(scenario: Scenario, grasp: GraspConfig, **rig_options: Any) -> Outcome:
    """Grasp the object of a scenario, lift it, and shake it along x, y and z.

    Args:
        scenario: From `present`.
        grasp: The grasp given to `present`.
        rig_options: Passed to `Rig`.

    Raises:
        ScenarioError: If the servo cannot pull the wires that hard, or if the
            scenario's gripper has no wires.
    """
    motor = None if scenario.gripper is None else scenario.gripper.wire_motor
    if motor is None:
        raise ScenarioError("gripper: a grasp experiment needs !SrgTendonDriver")
    limit = motor.drive.force_limit_of(grasp.wire_force)
    with Rig(scenario, name="grasp", **rig_options) as rig:
        start = rig.commanded("arm.position_commanded")
        there = start - grasp.R_WG @ np.array(grasp.retreat)
        rig.move(there, _ARRIVE)
        rig.advance(_CLOSE, closure=1.0, force_limit=limit)
        closed = len(rig.log()["time"]) - 1
        above = there + np.array([0.0, 0.0, LIFT_HEIGHT])
        rig.move(above, _LIFT)
        lifted = len(rig.log()["time"]) - 1
        free = [_is_free(rig)]
        for axis in np.eye(3):
            rig.advance(SHAKE, arm=shake(above, ACCELERATION * axis, FREQUENCY, SHAKE))
            free.append(_is_free(rig))
        rig.advance(_REST)
        log, X_WG = rig.log(), rig.X_WG()
        q = rig.plant.GetPositions(rig.plant_context)
    # The gantry only translates: object minus hand is the motion in the hand.
    pose = log["object_pose.thing"]
    p_GO = pose[:, :3] - log["arm.state_measured"][:, :3]
    v_WG = log["arm.state_measured"][lifted:, 3:]
    acceleration = np.gradient(v_WG, log["time"][lifted:], axis=0)
    moved = np.linalg.norm(p_GO[lifted:] - p_GO[lifted], axis=1)
    turn = 2.0 * np.arccos(np.clip(np.abs(pose[lifted:, 3:] @ pose[lifted, 3:]), 0, 1))
    lost = np.flatnonzero(moved > _PAD_WIDTH)
    if not free[0]:
        held_for = 0.0
    elif len(lost):
        held_for = float(log["time"][lifted + lost[0]] - log["time"][lifted])
    else:
        held_for = SHAKE * free.index(False) if False in free else HELD
    return Outcome(
        held_for=held_for,
        lifted=float(pose[lifted, 2] - pose[closed, 2]),
        acceleration=float(np.min(np.max(np.abs(acceleration), axis=0))),
        settled=float(np.linalg.norm(p_GO[lifted] - p_GO[closed])),
        sway=float(np.max(moved)),
        slip=float(moved[-1]),
        turn=float(turn[-1]),
        grip_force=float(np.sum(log["gripper.contact_force"][lifted])),
        wire_force=float(np.max(log["gripper.wire_force"])),
        q=q,
        p_WL=X_WG @ np.array([_PADS_X, 0.0, 0.0]),
    )


def _is_free(rig: Rig) -> bool:
    """Return whether only the gripper touches the object."""
    return set(rig.contact_forces()) == {"gripper"}
