"""What a grip holds: the payload experiments' common part."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw
from pydrake.multibody.parsing import AddModel, AddWeld, ModelDirective

from drake_srg.common.errors import ScenarioError
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.gripper.drivers import SrgTendonDriver
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.objects.config import ObjectConfig
from drake_srg.recording.figure import make_figure, style_axes
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder, Vector

# A cylinder of 68 mm, wide as the soup can; long enough to lie on the cradle. Painted
# metal on rubber, as the soup can.
RADIUS, LENGTH, FRICTION = 0.034, 0.16, 0.8
# x of the cylinder's middle in the palm frame by grip and direction [m]. Wrapped: 2 mm
# from the palm. Pinched: standing, along the pads, between their middles (the model's
# frame `grasp_center`); across the pads, where the tips stay on their stops: further in
# the wires curl them.
_X = {
    ("wrap", "down"): 0.074 + RADIUS,
    ("wrap", "side"): 0.074 + RADIUS,
    ("pinch", "down"): 0.1631,
    ("pinch", "side"): 0.155,
}
_MIDDLE = 0.5  # x of the bench's middle in world [m]
_POST_HEIGHT, _POST_Y = 0.15, 0.02  # of the cradle: the inner edges on which it lies
_CRADLE_Z = _POST_HEIGHT + np.sqrt(RADIUS**2 - _POST_Y**2)
# Times: the fingers close and the wires' force settles (7 times 0.3 s); then the arm
# lifts the object off its support, slowly, so that its momentum does not count when it
# slips, and holds it [s].
_CLOSE, _LIFT, HOLD = 3.5, 3.0, 10.0
_LIFT_HEIGHT = 0.06  # m
# Held is what moved less than this in the hand [m]: pinched, since the load came on;
# wrapped, since it rests on the tips, which have to reach around it, base and tip angle
# above 90 degrees. (Wrapped and palm down, even 2 kg settle from the base links onto
# the tips by 10 mm.)
_MOST_MOTION = 0.005

# To this share largest masses are found, and to this those of both scenarios agree.
_RESOLUTION, _AGREEMENT = 0.02, 0.05
_BENCH, _FAST = "gripper_bench", "gripper_bench_fast"

DIRECTIONS = ("down", "side")


@dc.dataclass(frozen=True)
class Load:
    """What a payload experiment asks of the gripper."""

    grip: str  # wrap: the fingers envelop the cylinder; pinch: between the pads
    direction: str  # where the palm points: down or to the side
    mass: float  # kg
    wire_force: float  # N, each wire


@dc.dataclass(frozen=True)
class Held:
    """What came of it."""

    held_for: float  # [s], at most HOLD
    slip: float  # motion in the hand while the load came on [m]
    creep: float  # motion in the hand during the hold [m]
    wire_force: float  # largest of both wires over the whole [N]
    time: Vector  # since the lift began, shape (K,) [s]
    moved: Vector  # distance in the hand from where it was then, shape (K,) [m]

    @property
    def held(self) -> bool:
        """Whether it was held to the end."""
        return self.held_for >= HOLD


def load_scenario_of(load: Load, scenario: str = _BENCH, **changes: Any) -> Scenario:
    """The bench with a cylinder in the open hand, on the table or on the cradle.

    Wrapped with the palm down, the cylinder lies across the hand; otherwise it stands.
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
    # Standing and taken from above, its upper half is between the pads.
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
    add = AddModel()
    add.name, add.file = "cradle", "package://drake_srg/sdf/cradle.sdf"
    weld = AddWeld()
    weld.parent, weld.child = "world", "cradle::cradle"
    weld.X_PC = Transform()
    weld.X_PC.translation = np.array([_MIDDLE, 0.0, 0.0])
    directives = [ModelDirective(), ModelDirective()]
    directives[0].add_model, directives[1].add_weld = add, weld
    return directives


def hold(load: Load, scenario: str = _BENCH, **changes: Any) -> Held:
    """Close on the cylinder, lift it off its support and hold it.

    Raises:
        ScenarioError: If the servo cannot pull the wires as hard, or the scenario's
            gripper has no wires.
    """
    bench = load_scenario_of(load, scenario, **changes)
    if not isinstance(bench.gripper, SrgTendonDriver):
        raise ScenarioError(f"{scenario}: gripper: a payload needs !SrgTendonDriver")
    limit = bench.gripper.drive.force_limit_of(load.wire_force)
    with Rig(bench, name="payload") as rig:
        rig.advance(_CLOSE, closure=1.0, force_limit=limit)
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, _LIFT_HEIGHT]), _LIFT)
        free = set(rig.contact_forces()) == {"gripper"}
        rig.advance(HOLD)
        log = rig.log()
    # The gantry does not turn the hand: what the object moves more than it, it slips.
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


def largest_mass(load: Load, scenario: str = _BENCH) -> Iterator[tuple[Load, Held]]:
    """Bisect for the largest mass that is held, from the load's own on.

    Yields:
        What was tried and what came of it, the load first; the heaviest that was held
        is within `_RESOLUTION` of the lightest that was not. Where a hundredth of the
        load is not held, nothing is.
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
        # By halves and doubles until there is a bracket, then its geometric mean.
        if lost == np.inf:
            mass = 2.0 * held
        else:
            mass = float(np.sqrt(max(held, lost / 4.0) * lost))


def payload_experiment(
    name: str, grip: str, mass: float, wire_force: float, track: Track
) -> ExperimentResult:
    """Hold the claimed mass in both directions, and find how much more would do."""
    rows: list[Row] = []
    columns: dict[str, list[Any]] = {k: [] for k in _COLUMNS}
    curves: dict[str, Held] = {}
    most: dict[tuple[str, str], float] = {}
    cases = [(direction, scenario) for direction in DIRECTIONS for scenario in _TRIED]
    for direction, scenario in track(cases, label=", ".join):
        claim = Load(grip, direction, mass, wire_force)
        tried = list(largest_mass(claim, scenario))
        for load, held in tried:
            results = (held.held_for, held.slip, held.creep)
            values = (scenario, direction, load.mass, *results)
            for column, value in zip(columns.values(), values, strict=True):
                column.append(value)
        most[direction, scenario] = max(
            (load.mass for load, held in tried if held.held), default=0.0
        )
        if scenario == _BENCH:
            curves[direction] = tried[0][1]
    full = TendonDriveConfig().full_wire_force
    for direction, first in curves.items():
        case = f"{grip}, {direction}"
        bench, fast = (most[direction, scenario] for scenario in _TRIED)
        rows += [
            Row.at_least(case, f"{mass:g} kg held for", HOLD, first.held_for, "s"),
            Row.at_most(case, "wire force", full, first.wire_force, "N"),
            Row.info(case, "slip while the load comes on", first.slip * 1e3, "mm"),
            Row.info(case, "creep while held", first.creep / HOLD * 1e6, "um/s"),
            Row.at_least(case, "largest mass held", mass, bench, "kg"),
            Row.within(
                case, f"the same, {_FAST}", bench, fast, "kg", relative=_AGREEMENT
            ),
        ]
    return ExperimentResult(rows, {"masses": columns}, _draw(name, columns, curves))


_TRIED = (_BENCH, _FAST)
_COLUMNS = ("scenario", "direction", "mass_kg", "held_for_s", "slip_m", "creep_m")


def _draw(title: str, columns: dict[str, list[Any]], curves: dict[str, Held]) -> Any:
    figure = make_figure(9.0, 3.4, title)
    left, right = figure.subplots(1, 2)
    style_axes(left, xlabel="time since the lift began [s]", ylabel="moved [mm]")
    for direction, held in curves.items():
        left.plot(held.time, held.moved * 1e3, label=direction)
    left.legend(fontsize=8, frameon=False)
    style_axes(right, xlabel="mass [kg]", ylabel="held for [s]")
    for direction, marker in zip(curves, "os", strict=True):
        points = [
            (mass, held_for)
            for case, name, mass, held_for, *_ in zip(*columns.values(), strict=True)
            if (case, name) == (_BENCH, direction)
        ]
        right.plot(*zip(*points, strict=True), marker, label=direction)
    right.legend(fontsize=8, frameon=False)
    return figure
