"""A grasp of a sponge, simulated: what the experiment `soft` judges."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.multibody.tree import DeformableBody

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.moment_arms import base_moment_arm
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.gripper.underactuation import JOINT_NAMES
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import object_body
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Vector

# A piece of a dry kitchen sponge, x, y (across the hand) and z [m], and its density
# [kg/m³] and stiffness: those of `SoftConfig`. Foam on rubber: between the 0.2 and 3
# that polyurethanes have.
SIZE, DENSITY, FOAM, FRICTION = [0.04, 0.06, 0.045], 30.0, SoftConfig(), 0.6
# Middle of a pad's flat face in the tip's frame [m], and its distance from the base
# hinge with the tip straight.
PAD_MIDDLE = [SRG.pad_middle, SRG.face_offset, 0.0]
LEVER = SRG.base_length + SRG.pad_middle
# The hand's height: with parallel fingers, the pads' lower ends are this much above the
# table, and the upper ones above the sponge [m].
HEIGHT, CLEARANCE = 0.1854, 0.002
# The fingers close and the force settles; the arm lifts; it holds still.
CLOSE, LIFT, HOLD = 5.0, 1.0, 5.0  # s
LIFT_HEIGHT = 0.06  # m
# The longest step that soft bodies allow, and a mesh that is fast: 3 x 4 x 3 cells.
TIME_STEP, RESOLUTION = 0.005, 0.015  # s, m
_SAMPLE = 0.05  # s

# Where the camera sees hand and sponge at the end of the hold.
_CAMERA = [
    "cameras.overview.X_PB.translation=[1.0, -0.25, 0.16]",
    "cameras.overview.X_PB.rotation=!Rpy {deg: [-94, 0, 63.5]}",
    "cameras.overview.focal=!FovDegrees {y: 18.0}",
    "cameras.overview.width=480",
    "cameras.overview.height=480",
]


@dc.dataclass(frozen=True)
class Case:
    """A grasp of the sponge."""

    wire_force: float  # N
    time_step: float = TIME_STEP
    resolution: float = RESOLUTION


@dc.dataclass(frozen=True)
class Grasp:
    """What came of it, sampled every `_SAMPLE` (K)."""

    time: Vector  # s
    squeeze: Vector  # width lost between the pads' middles over the free width
    force: Vector  # mean of both fingertips' sensors [N]
    wire_force: Vector  # mean of both wires [N]
    moved: Vector  # in the hand, from where it was when lifted [m]
    expected_force: float  # from the wires' at the end of the hold [N]
    lifted: float  # lowest vertex above the table after the lift [m]
    touched: set[str]  # what touches the sponge then
    least_volume: float  # least of an element, now and then, over its free volume
    picture: npt.NDArray[np.uint8] | None  # at the end of the hold

    def at_rest(self, values: Vector) -> float:
        """Mean over the last second of the hold."""
        end = CLOSE + LIFT + HOLD
        return float(values[(self.time > end - 1.0) & (self.time < end + 1e-6)].mean())


def grasp(
    case: Case, *, hold: float = HOLD, ramp: float = 0.0, picture: bool = False
) -> Grasp:
    """Close on the sponge, lift it, hold it, and perhaps pull harder and harder.

    Args:
        case: How.
        hold: How long it is held [s].
        ramp: How long the pull then grows, up to all that the servo gives [s].
        picture: Whether to take one at the end of the hold.
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
    if ramp:  # the spool may wind more than closes an empty hand
        overrides.append("gripper.spool.full_scale=5")
    scenario = bench_scenario(thing, home=[0.0, 0.0, HEIGHT], overrides=overrides)
    assert scenario.gripper is not None and scenario.gripper.wire_motor is not None
    limit = scenario.gripper.wire_motor.drive.force_limit_of(case.wire_force)
    least = np.inf
    with Rig(scenario, name="soft", log_period=_SAMPLE, images=picture) as rig:
        elements = _Elements(rig)

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
        squeeze = 1.0 - _pad_gap(rig, log["gripper.state_measured"]) / SIZE[1]
    # The gantry does not turn the hand: what the sponge moves more than it, it slips.
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


class _Elements:
    """The sponge's vertices and tetrahedra."""

    def __init__(self, rig: Rig) -> None:
        model = rig.plant.GetModelInstanceByName("thing")
        body = object_body(rig.plant, model)
        assert isinstance(body, DeformableBody)
        inspector = rig.station.GetSubsystemByName("scene_graph").model_inspector()
        mesh = inspector.GetReferenceMesh(body.geometry_id())
        self._body, self._context = body, rig.plant_context
        self._corners = np.array(
            [[t.vertex(i) for i in range(4)] for t in mesh.tetrahedra()]
        )
        self._free = self._volumes(body.reference_positions().reshape(-1, 3).T)

    def vertices(self) -> Vector:
        """In world, shape (3, n) [m]."""
        return np.array(self._body.GetPositions(self._context))

    def least_volume(self) -> float:
        """Least volume of an element over its free one; inverted ones are below 0."""
        return float(np.min(self._volumes(self.vertices()) / self._free))

    def _volumes(self, p: Vector) -> Vector:
        a, b, c, d = (p[:, i].T for i in self._corners.T)
        volumes: Vector = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
        return volumes


def _pad_gap(rig: Rig, state: Vector) -> Vector:
    """Distance between the pads' middles for measured states (K, 8) [m]."""
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
    """Grip force that balances the wires' moments about the base hinges [N]."""
    q, spring = rig.measured("gripper.state_measured")[:2], TendonDriveConfig()
    back = spring.base_spring.preload + spring.base_spring.stiffness * q
    moment = rig.measured("gripper.wire_force") * base_moment_arm(q) - back
    return float(np.mean(moment) / LEVER)
