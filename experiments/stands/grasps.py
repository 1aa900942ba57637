"""One grasp of a household object from beginning to end.

data/grasps.yaml says how each object is presented and grasped, and why.
"""

import copy
import dataclasses as dc
import time as wall_clock
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw, RotationMatrix

import experiments.runner as ex
from drake_srg.common.geometry import look_at
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import Scenario
from drake_srg.scenario.typed_yaml import load_typed
from drake_srg.simulation.rig import Rig, bench_scenario, shake
from drake_srg.types import Box, Vector
from experiments.data import household_objects, read_yaml
from experiments.stands.holding import in_hand, is_free

MIDDLE = np.array([0.5, 0.0, 0.0])  # origin of the gantry's joint positions [m]
# Times [s]. The hand arrives. The fingers close (up to 2.5 s with a loose wire) and the
# wire force settles (time constant 0.3 s). The arm lifts. Each shake has two cycles
# that swell, one at full strength and two that fade. Then everything comes to rest.
ARRIVE, CLOSE, LIFT, SHAKE, REST = 1.0, 3.5, 0.8, 2.5, 0.3
LIFT_HEIGHT = 0.1  # m
ACCELERATION, FREQUENCY = 9.81, 2.0  # m/s², Hz
HELD = 3.0 * SHAKE  # from the end of the lift to the end of the last shake [s]
_STEEL = 7850.0  # kg/m³, so heavy that no hand moves it
_PADS = np.array([0.158, 0.0, 0.0])  # middle of straight fingers' pads in the palm [m]
# Position of the camera relative to the pads: in front, to the right of the hand and
# above, at a distance that shows 0.3 m [m].
_EYE = np.array([0.30, -0.28, 0.17])
# An object is lost when it moves in the hand by more than the width of a pad [m].
_PAD_WIDTH = 0.03


def numbers(*default: float) -> Any:
    """Return a field of a fixed number of numbers."""
    metadata = {"length": len(default)}
    return dc.field(default_factory=lambda: [*default], metadata=metadata)


@dc.dataclass(kw_only=True)
class Support:
    """A steel block on the bench."""

    size: list[float] = numbers(0.1, 0.1, 0.1)  # x, y, z [m]
    at: list[float] = numbers(0.0, 0.0)  # its middle from the bench's middle [m]


@dc.dataclass(kw_only=True)
class GraspConfig:
    """The presentation of an object to the hand, and the grasp."""

    # Roll, pitch, yaw of the palm [degrees]: [0, 0, 0] points to the front and closes
    # horizontally; [0, 90, 0] points down; [90, 0, 0] closes vertically.
    hand: list[float] = numbers(0.0, 0.0, 0.0)
    # The object's origin in the palm frame when the fingers close [m].
    grip: list[float] = numbers(0.15, 0.0, 0.0)
    why: str = ""  # reason for this grasp
    object: list[float] = numbers(0.0, 0.0, 0.0)  # its roll, pitch, yaw [degrees]
    # Height of the object's support [m].
    height: float = dc.field(default=0.0, metadata={"ge": 0.0})
    supports: list[Support] = dc.field(default_factory=list)
    # Start of the approach, in the palm frame, relative to the grasp [m].
    retreat: list[float] = numbers(-0.12, 0.0, 0.0)
    wire_force: float = dc.field(default=80.0, metadata={"ge": 0.0})  # per wire [N]

    @property
    def R_WG(self) -> RotationMatrix:
        return RollPitchYaw(np.deg2rad(self.hand)).ToRotationMatrix()

    @property
    def R_WO(self) -> RotationMatrix:
        return RollPitchYaw(np.deg2rad(self.object)).ToRotationMatrix()


def grasps() -> dict[tuple[str, str], GraspConfig]:
    """Return every grasp of data/grasps.yaml by object and approach.

    The approach is `above` or `side`; a remark after a comma marks an unusual grasp.
    """
    return {
        (name, approach): load_typed(
            GraspConfig, grasp, f"grasps.yaml: {name}: {approach}"
        )
        for name, ways in read_yaml("grasps.yaml").items()
        for approach, grasp in ways.items()
    }


def width_between_pads(name: str, grasp: GraspConfig) -> float:
    """Return an object's extent along the palm's y [m]; NaN for a compound model."""
    shape = simple_shape("thing", household_objects()[name])
    u_O = grasp.R_WO.matrix().T @ grasp.R_WG.matrix()[:, 1]
    return np.nan if shape is None else 2.0 * shape.half_extent(u_O)


def present(
    thing: ObjectConfig,
    grasp: GraspConfig,
    scenario: str = "gripper_bench",
    overrides: Sequence[str] = (),
) -> Scenario:
    """Return the bench with an object to grasp and the hand in front of it.

    Raises:
        ValueError: If a model that stands on its x-y plane is tilted.
    """
    thing = copy.deepcopy(thing)
    z_O = grasp.R_WO.matrix()[2]
    shape, height = simple_shape("thing", thing), 0.0  # of the origin
    if shape is not None:
        height = shape.half_extent(z_O)
    elif not np.isclose(z_O[2], 1.0):
        raise ValueError("a model must stand upright")
    p_WO = MIDDLE + np.array([0.0, 0.0, grasp.height + height])
    thing.pose = Transform()
    thing.pose.translation = p_WO
    thing.pose.rotation = Rotation(RollPitchYaw(np.deg2rad(grasp.object)))
    p_WG = p_WO - grasp.R_WG @ np.array(grasp.grip) - MIDDLE
    home = list(p_WG + grasp.R_WG @ np.array(grasp.retreat))
    bench = bench_scenario(
        thing, gripper_rpy=grasp.hand, home=home, scenario=scenario, overrides=overrides
    )
    for i, support in enumerate(grasp.supports):
        bench.objects[f"support_{i}"] = ObjectConfig(
            shape=Box(support.size),
            mass=_STEEL * float(np.prod(support.size)),
            friction=0.6,
            color=[0.45, 0.46, 0.48],
            position=[MIDDLE[0] + support.at[0], support.at[1]],
        )
    return bench


def _on_white(rig: Rig) -> npt.NDArray[np.uint8]:
    """Return the camera's image of gripper and objects, on white."""
    image = rig.image("overview")
    sensor = rig.station.GetSubsystemByName("rgbd_sensor_overview")
    context = sensor.GetMyContextFromRoot(rig.context)
    # The label of a pixel is the index of the body that it shows.
    label = sensor.label_image_output_port().Eval(context).data[:, :, 0]
    models = map(rig.plant.GetModelInstanceByName, ("gripper", *rig.scenario.objects))
    shown = [int(body) for model in models for body in rig.plant.GetBodyIndices(model)]
    image[~np.isin(label, shown)] = 255
    return image


def stops(scenario: Scenario, grasp: GraspConfig) -> tuple[Vector, Vector]:
    """Return the gantry's positions (3) where the hand grasps, and after the lift."""
    there = scenario.arm.home - grasp.R_WG @ np.array(grasp.retreat)
    return there, there + np.array([0.0, 0.0, LIFT_HEIGHT])


def creep(time: Vector, p_GO: Vector, seconds: float) -> float:
    """Return the mean speed of p_GO (K, 3) [m] in the last seconds [um/s]."""
    start = np.searchsorted(time, time[-1] - seconds)
    way = np.linalg.norm(p_GO[-1] - p_GO[start])
    return 1e6 * float(way / (time[-1] - time[start]))


def simulate(scenario: Scenario, grasp: GraspConfig, hold: float = 0.0) -> ex.Measures:
    """Grasp the object of a scenario, lift it, and shake it along x, y and z.

    With `hold`, the hand then waits for so long [s], which tells the `creep` of the
    object in its last 4/5 [um/s], and `wall`, the time that a simulated second takes.

    Return `held_for`: time after the lift during which only the gripper touches the
    object [s]; `acceleration`: peak of the hand's along the axis where that is lowest
    [m/s²]; `slip` [mm] and `turn` [degrees] in the hand that remain at the end;
    `grip_force` of all finger links after the lift; the largest `wire_force` [N]; an
    `image` of the hand at the end.
    """
    limit = scenario.gripper.wire_motor.drive.force_limit_of(grasp.wire_force)
    there, above = stops(scenario, grasp)
    camera, p_WL = scenario.cameras["overview"], MIDDLE + above + grasp.R_WG @ _PADS
    camera.width = camera.height = 190
    camera.X_PB = Transform(look_at(p_WL + _EYE, p_WL))
    camera.X_PB.base_frame = "world"
    with Rig(scenario, name="grasp", images=True) as rig:
        start = wall_clock.perf_counter()
        rig.move(there, ARRIVE)
        rig.advance(CLOSE, closure=1.0, force_limit=limit)
        rig.move(above, LIFT)
        lifted = len(rig.log()["time"]) - 1
        free = [is_free(rig)]
        for axis in np.eye(3):
            rig.advance(SHAKE, arm=shake(above, ACCELERATION * axis, FREQUENCY, SHAKE))
            free.append(is_free(rig))
        rig.advance(REST)
        shaken = len(rig.log()["time"])
        rig.advance(hold)
        wall = wall_clock.perf_counter() - start
        log, image = rig.log(), _on_white(rig)
    held = {}
    if hold:
        held["creep"] = creep(log["time"], in_hand(log), 0.8 * hold)
        held["wall"] = wall / log["time"][-1]
        log = {key: values[:shaken] for key, values in log.items()}
    quaternion, time = log["object_pose.thing"][lifted:, 3:], log["time"][lifted:]
    p_GO = in_hand(log)[lifted:]
    speed = log["arm.state_measured"][lifted:, 3:]
    acceleration = np.gradient(speed, time, axis=0)
    moved = np.linalg.norm(p_GO - p_GO[0], axis=1)
    turn = 2.0 * np.arccos(np.clip(np.abs(quaternion @ quaternion[0]), 0, 1))
    lost = np.flatnonzero(moved > _PAD_WIDTH)
    held_for = SHAKE * free.index(False) if False in free else HELD
    if free[0] and len(lost):
        held_for = float(time[lost[0]] - time[0])
    return {
        "held_for": held_for,
        "acceleration": np.min(np.max(np.abs(acceleration), axis=0)),
        "slip": 1e3 * moved[-1],
        "turn": np.rad2deg(turn[-1]),
        "grip_force": np.sum(log["gripper.contact_force"][lifted]),
        "wire_force": np.max(log["gripper.wire_force"]),
        "image": image,
        **held,
    }
