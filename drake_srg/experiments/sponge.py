"""A simulated grasp of a sponge, which the experiment `soft` judges."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.multibody.tree import DeformableBody

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.tendon import TendonDriveConfig, base_moment_arm
from drake_srg.gripper.underactuation import JOINT_NAMES
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import object_body
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Vector

# A piece of a dry kitchen sponge: x, y (across the hand) and z [m], density [kg/m³],
# the stiffness of `SoftConfig`, and friction of foam on rubber, within the 0.2 to 3 of
# polyurethanes.
SIZE, DENSITY, FOAM, FRICTION = [0.04, 0.06, 0.045], 30.0, SoftConfig(), 0.6
# Middle of a pad's flat face in the tip's frame [m], and its distance from the base
# hinge with the tip straight.
PAD_MIDDLE = [SRG.pad_middle, SRG.face_offset, 0.0]
LEVER = SRG.base_length + SRG.pad_middle
# Height of the hand. With parallel fingers, the lower ends of the pads are `CLEARANCE`
# above the table, and the upper ends as much above the sponge [m].
HEIGHT, CLEARANCE = 0.1854, 0.002
# The fingers close and the force settles; the arm lifts; it holds still [s].
CLOSE, LIFT, HOLD = 5.0, 1.0, 5.0
LIFT_HEIGHT = 0.06  # m
# The longest step that soft bodies allow [s], and a fast mesh of 3 x 4 x 3 cells [m].
TIME_STEP, RESOLUTION = 0.005, 0.015
_SAMPLE = 0.05  # s

# A camera that sees hand and sponge at the end of the hold.
_CAMERA = [
    "cameras.overview.X_PB.translation=[1.0, -0.25, 0.16]",
    "cameras.overview.X_PB.rotation=!Rpy {deg: [-94, 0, 63.5]}",
    "cameras.overview.focal=!FovDegrees {y: 18.0}",
    "cameras.overview.width=480",
    "cameras.overview.height=480",
]


@dc.dataclass(frozen=True)
class Case:
    """A grasp of the sponge: force of each wire [N], time step [s], mesh [m]."""

    wire_force: float
    time_step: float = TIME_STEP
    resolution: float = RESOLUTION


@dc.dataclass(frozen=True)
class Grasp:
    """The outcome of a grasp; series are sampled every `_SAMPLE`, shape (K,).

    Attributes:
        time: [s].
        squeeze: Width lost between the pads' middles, over the free width.
        force: Mean of both fingertips' sensors [N].
        wire_force: Mean of both wires [N].
        moved: Distance in the hand from the position after the lift [m].
        expected_force: Grip force from the wire force at the end of the hold [N].
        lifted: Height of the lowest vertex above the table after the lift [m].
        touched: Names of everything that touches the sponge after the lift.
        least_volume: Smallest volume of an element over its free volume, checked every
            0.5 s.
        picture: Taken at the end of the hold.
    """

    time: Vector
    squeeze: Vector
    force: Vector
    wire_force: Vector
    moved: Vector
    expected_force: float
    lifted: float
    touched: set[str]
    least_volume: float
    picture: npt.NDArray[np.uint8] | None

    def at_rest(self, values: Vector) -> float:
        """Return the mean of a series over the last second of the hold."""
        end = CLOSE + LIFT + HOLD
        return float(values[(self.time > end - 1.0) & (self.time < end + 1e-6)].mean())


def grasp(
    case: Case, *, hold: float = HOLD, ramp: float = 0.0, picture: bool = False
) -> Grasp:
    """Close on the sponge, lift it, hold it and, with a ramp, pull ever harder.

    Args:
        case: Wire force, time step and mesh.
        hold: Duration of the hold [s].
        ramp: Duration of the ramp of the pull up to the servo's limit [s].
        picture: Whether to take a picture at the end of the hold.
    """
    thing = ObjectConfig(
        shape=Box(SIZE),
        soft=FOAM,
        mass=DENSITY * float(np.prod(SIZE)),
        friction=FRICTION,
        resolution=case.resolution,
        color=[0.95, 0.75, 0.2],
    )
    overrides = [
        f"plant_config.time_step={case.time_step}",
        f"arm.period={case.time_step}",
        *(_CAMERA if picture else []),
    ]
    if ramp:  # lets the spool wind farther than it takes to close an empty hand
        overrides.append("gripper.spool.full_scale=5")
    scenario = bench_scenario(thing, home=[0.0, 0.0, HEIGHT], overrides=overrides)
    assert scenario.gripper is not None and scenario.gripper.wire_motor is not None
    limit = scenario.gripper.wire_motor.drive.force_limit_of(case.wire_force)
    least = np.inf
    with Rig(scenario, name="soft", log_period=_SAMPLE, images=picture) as rig:
        elements = Elements(rig)

        def advance(duration: float, **commands: Any) -> None:
            nonlocal least
            for _ in range(round(duration / 0.5)):
                rig.advance(0.5, **commands)
                least = min(least, elements.least_volume())

        advance(CLOSE, closure=1.0, force_limit=limit)
        rig.move([0.0, 0.0, HEIGHT + LIFT_HEIGHT], LIFT)
        lifted = float(elements.vertices()[2].min())
        touched = set(rig.contact_forces())
        advance(hold)
        image = rig.image("overview") if picture else None
        expected = _statics(rig)
        if ramp:
            rig.advance(ramp, force_limit=lambda t: limit + (1.0 - limit) * t / ramp)
        log = rig.log()
        squeeze = 1.0 - pad_gap(rig, log["gripper.state_measured"]) / SIZE[1]
    # The gantry only translates: whatever the sponge moves beyond the hand is slip.
    p_GO = log["object_pose.thing"][:, :3] - log["arm.state_measured"][:, :3]
    start_row = int(np.argmin(np.abs(log["time"] - CLOSE - LIFT)))
    return Grasp(
        time=log["time"],
        squeeze=squeeze,
        force=log["gripper.contact_force"][:, 2:].mean(axis=1),
        wire_force=log["gripper.wire_force"].mean(axis=1),
        moved=np.linalg.norm(p_GO - p_GO[start_row], axis=1),
        expected_force=expected,
        lifted=lifted,
        touched=touched,
        least_volume=least,
        picture=image,
    )


class Elements:
    """The vertices and tetrahedra of a rig's sponge.

    Attributes:
        body: The sponge.
        context: Of the plant.
    """

    def __init__(self, rig: Rig) -> None:
        model = rig.plant.GetModelInstanceByName("thing")
        body = object_body(rig.plant, model)
        assert isinstance(body, DeformableBody)
        inspector = rig.station.GetSubsystemByName("scene_graph").model_inspector()
        mesh = inspector.GetReferenceMesh(body.geometry_id())
        self.body, self.context = body, rig.plant_context
        self._corners = np.array(
            [[t.vertex(i) for i in range(4)] for t in mesh.tetrahedra()]
        )
        self._free = self._volumes(body.reference_positions().reshape(-1, 3).T)

    def vertices(self) -> Vector:
        """Return the vertices in world, shape (3, n) [m]."""
        return np.array(self.body.GetPositions(self.context))

    def least_volume(self) -> float:
        """Return the smallest volume of an element over its free volume.

        Inverted elements count below 0.
        """
        return float(np.min(self._volumes(self.vertices()) / self._free))

    def _volumes(self, p: Vector) -> Vector:
        a, b, c, d = (p[:, i].T for i in self._corners.T)
        volumes: Vector = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
        return volumes


def pad_gap(rig: Rig, state: Vector) -> Vector:
    """Return the distance between the pads' middles, shape (K,) [m].

    Args:
        rig: Gives the plant.
        state: Measured states of the gripper, shape (K, 8).
    """
    plant, context = rig.plant, rig.plant.CreateDefaultContext()
    gripper = plant.GetModelInstanceByName("gripper")
    joints = [plant.GetJointByName(f"{name}_joint", gripper) for name in JOINT_NAMES]
    tips = [plant.GetFrameByName(f"{s}_tip_link", gripper) for s in ("left", "right")]
    gaps = []
    for q in state[:, : len(joints)]:
        for joint, angle in zip(joints, q, strict=True):
            joint.set_angle(context, angle)
        left, right = (frame.CalcPoseInWorld(context) @ PAD_MIDDLE for frame in tips)
        gaps.append(np.linalg.norm(left - right))
    return np.array(gaps)


def _statics(rig: Rig) -> float:
    """Return the grip force that balances the wires at the base hinges [N]."""
    q, spring = rig.measured("gripper.state_measured")[:2], TendonDriveConfig()
    back = spring.base_spring.preload + spring.base_spring.stiffness * q
    moment = rig.measured("gripper.wire_force") * base_moment_arm(q) - back
    return float(np.mean(moment) / LEVER)
