"""A cylinder held in the hand: how long, and how heavy it may be."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw
from pydrake.multibody.parsing import AddModel, AddWeld, ModelDirective

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.objects.config import ObjectConfig
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder, Vector

# As wide as the soup can and long enough to lie on the cradle; friction of painted
# metal on rubber, like the can.
RADIUS, LENGTH, FRICTION = 0.034, 0.16, 0.8
# x of the cylinder's middle in the palm frame, by grip and direction [m]. Wrapped: 2 mm
# from the palm. Pinched, palm down: standing along the pads, between their middles (the
# model's frame `grasp_center`). Pinched, to the side: across the pads, where the tips
# stay on their stops. Further in, the wires curl the tips.
_X = {
    ("wrap", "down"): SRG.palm_face_x + 0.002 + RADIUS,
    ("wrap", "side"): SRG.palm_face_x + 0.002 + RADIUS,
    ("pinch", "down"): SRG.grasp_center_x,
    ("pinch", "side"): 0.155,
}
_MIDDLE = 0.5  # x of the bench's middle in world [m]
_POST_HEIGHT, _POST_Y = 0.15, 0.02  # inner edges of the cradle, which carry it [m]
_CRADLE_Z = _POST_HEIGHT + np.sqrt(RADIUS**2 - _POST_Y**2)
# The fingers close and the wire force settles (7 time constants of 0.3 s). Then the arm
# lifts the object off its support and holds it. The lift is slow, so that momentum does
# not add to slip [s].
_CLOSE, _LIFT, HOLD = 3.5, 3.0, 10.0
_LIFT_HEIGHT = 0.06  # m
# An object counts as held while it moves less than this in the hand [m]. Pinched,
# motion counts from when the load comes on. Wrapped, it counts from the end of the
# lift, because heavy cylinders settle from the base links onto the tips (palm down;
# 5 kg by 12 mm). The tips must then reach around the object: base plus tip angle above
# 90 degrees.
_MOST_MOTION = 0.005

_RESOLUTION = 0.02  # relative, of largest masses
BENCH = "gripper_bench"


@dc.dataclass(frozen=True)
class Load:
    """A cylinder to hold, and how.

    Attributes:
        grip: `wrap`: the fingers envelop the cylinder; `pinch`: between the pads.
        direction: Where the palm points: `down` or to the `side`.
        mass: Of the cylinder [kg].
        wire_force: Of each wire [N].
    """

    grip: str
    direction: str
    mass: float
    wire_force: float


@dc.dataclass(frozen=True)
class Held:
    """The outcome of holding a load.

    Attributes:
        held_for: How long the load was held, at most HOLD [s].
        slip: Motion in the hand while the load comes on [m].
        creep: Motion in the hand during the hold [m].
        wire_force: Largest force of either wire at any time [N].
        time: Since the lift began, shape (K,) [s].
        moved: Distance in the hand from the position at time 0, shape (K,) [m].
    """

    held_for: float
    slip: float
    creep: float
    wire_force: float
    time: Vector
    moved: Vector

    @property
    def held(self) -> bool:
        """Whether the load was held to the end."""
        return self.held_for >= HOLD


def payload_scenario(load: Load, scenario: str = BENCH, **changes: Any) -> Scenario:
    """Return the bench with a cylinder in the open hand, on the table or the cradle.

    Wrapped with the palm down, the cylinder lies across the hand on the cradle;
    otherwise it stands on the table.

    Args:
        load: The cylinder and how it is taken.
        scenario: The bench.
        changes: Passed to `bench_scenario`.
    """
    thing = ObjectConfig(
        shape=Cylinder(RADIUS, LENGTH), mass=load.mass, friction=FRICTION
    )
    x = _X[load.grip, load.direction]
    lying = (load.grip, load.direction) == ("wrap", "down")
    if lying:
        thing.pose = Transform()
        thing.pose.translation = np.array([_MIDDLE, 0.0, _CRADLE_Z])
        thing.pose.rotation = Rotation(RollPitchYaw(0.0, np.pi / 2, 0.0))
    # Standing and taken from above, the cylinder has its upper half between the pads.
    height = _CRADLE_Z if lying else 0.5 * LENGTH
    down = load.direction == "down"
    if down and not lying:
        height = 0.7 * LENGTH
    bench = bench_scenario(
        thing,
        gripper_rpy=[0.0, 90.0, 0.0] if down else [0.0, 0.0, 0.0],
        home=[0.0, 0.0, height + x] if down else [-x, 0.0, height],
        scenario=scenario,
        **changes,
    )
    if lying:
        bench.directives.extend(_cradle())
    return bench


def _cradle() -> list[ModelDirective]:
    """Return directives that weld the cradle to the world below the hand."""
    add = AddModel()
    add.name, add.file = "cradle", "package://drake_srg/sdf/cradle.sdf"
    weld = AddWeld()
    weld.parent, weld.child = "world", "cradle::cradle"
    weld.X_PC = Transform()
    weld.X_PC.translation = np.array([_MIDDLE, 0.0, 0.0])
    directives = [ModelDirective(), ModelDirective()]
    directives[0].add_model, directives[1].add_weld = add, weld
    return directives


def hold(load: Load, scenario: str = BENCH, **changes: Any) -> Held:
    """Close on the cylinder, lift it off its support and hold it.

    Args:
        load: The cylinder and how it is taken.
        scenario: The bench.
        changes: Passed to `bench_scenario`.

    Raises:
        ScenarioError: If the servo cannot pull the wires that hard, or if the
            scenario's gripper has no wires.
    """
    bench = payload_scenario(load, scenario, **changes)
    motor = None if bench.gripper is None else bench.gripper.wire_motor
    if motor is None:
        raise ScenarioError(f"{scenario}: gripper: a payload needs !SrgTendonDriver")
    limit = motor.drive.force_limit_of(load.wire_force)
    with Rig(bench, name="payload") as rig:
        rig.advance(_CLOSE, closure=1.0, force_limit=limit)
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, _LIFT_HEIGHT]), _LIFT)
        free = set(rig.contact_forces()) == {"gripper"}
        rig.advance(HOLD)
        log = rig.log()
    # The gantry only translates: whatever the object moves beyond the hand is slip.
    p_GO = log["object_pose.thing"][:, :3] - log["arm.state_measured"][:, :3]
    time = log["time"] - _CLOSE
    closed, lifted = (int(np.argmin(np.abs(time - t))) for t in (0.0, _LIFT))
    q = log["gripper.state_measured"][:, :4]
    angle = np.min([q[:, base] + q[:, tip] for base, tip in FINGERS], axis=0)
    since = closed if load.grip == "pinch" else lifted
    lost = np.linalg.norm(p_GO - p_GO[since], axis=1)[lifted:] > _MOST_MOTION
    if load.grip == "wrap":
        lost |= angle[lifted:] < 0.5 * np.pi
    held_for = HOLD
    if lost.any():
        held_for = float(time[lifted + np.argmax(lost)] - _LIFT)
    return Held(
        held_for=held_for if free else 0.0,
        slip=float(np.linalg.norm(p_GO[lifted] - p_GO[closed])),
        creep=float(np.linalg.norm(p_GO[-1] - p_GO[lifted])),
        wire_force=float(np.max(log["gripper.wire_force"])),
        time=time[closed:],
        moved=np.linalg.norm(p_GO[closed:] - p_GO[closed], axis=1),
    )


def largest_mass(load: Load, scenario: str = BENCH) -> Iterator[tuple[Load, Held]]:
    """Bisect for the largest mass that the grip holds, starting with the load's own.

    Yields:
        Each load tried with its outcome, the given load first. At the end, the heaviest
        mass held is within `_RESOLUTION` of the lightest mass lost. The search gives up
        when a hundredth of the given mass is lost.
    """
    held, lost = 0.0, np.inf
    mass = load.mass
    while lost > max(held * (1.0 + _RESOLUTION), 0.01 * load.mass):
        attempt = dc.replace(load, mass=mass)
        result = hold(attempt, scenario)
        yield attempt, result
        if result.held:
            held = mass
        else:
            lost = mass
        # Double or halve until the limit is bracketed, then take geometric means.
        if lost == np.inf:
            mass = 2.0 * held
        else:
            mass = float(np.sqrt(max(held, lost / 4.0) * lost))
