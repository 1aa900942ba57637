"""One grasp in `kitchen_servoing`, by one way of looking."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Collection, Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import MakeSimulator
from drake_srg.lifetime import free_diagrams, my_context
from drake_srg.objects.models import object_shape
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.scenario import Scenario, load_scenario, servo_of
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.simulate import failure_time
from drake_srg.station import AddCell, MakeCell
from drake_srg.station.planners import MakeHand
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, Vector

SCENARIO = "kitchen_servoing"
# An object that has risen this far with the hand is lifted [m], as in metrics.json.
_LIFTED = 0.015
LONGEST = 12.0  # of a trial [s]
# The grasp is over, well or badly, once one of these modes begins.
_OVER = {Mode.TRANSFER, Mode.RELEASE, Mode.RETREAT, Mode.FAILED, Mode.DONE}
# The planner of `kitchen_servoing` without its servo.
_LOOK_ONCE = (
    "planner=!PickAndPlace {approaches: [above], period: 0.01171875, clearance: 0.02, "
    "hand_clearance: 0.01, tilts: [0.05, 0.1745]}"
)
# Each way of looking, and the camera on which its grasp relies. Looking once is what
# `kitchen` does. Looking twice goes, without following, where the first image of the
# hand's camera shows the object by its calibration.
METHODS: dict[str, tuple[str, tuple[str, ...]]] = {
    "look once": ("ceiling", (_LOOK_ONCE,)),
    "look twice": (
        "hand",
        (
            "planner.servo.looks=1",
            "planner.servo.feed_forward=false",
            "planner.servo.goal=calibrated",
        ),
    ),
    "pbvs": ("hand", ("planner.servo.method=pbvs",)),
    "ibvs": ("hand", ("planner.servo.method=ibvs",)),
}


@dc.dataclass(frozen=True)
class Case:
    """What makes a grasp hard.

    Attributes:
        speed: Of the object [m/s].
        distance: By which the camera's believed position is off [m].
        angle: By which its believed orientation is off [rad].
    """

    speed: float = 0.0
    distance: float = 0.0
    angle: float = 0.0

    def __str__(self) -> str:
        if self.distance:
            return f"{1e3 * self.distance:g} mm, {np.degrees(self.angle):g} degrees off"
        return f"{1e3 * self.speed:g} mm/s"


@dc.dataclass(frozen=True)
class Grasped:
    """The end of a trial.

    Attributes:
        held: Whether the object was lifted and held.
        error: Distance of the object's centre from its place in the hand as the fingers
            begin to close [m]; None: they did not.
        across: The part of it across the fingers' reach [m]; None likewise.
        reason: Why it was not held, or "".
    """

    held: bool
    error: float | None
    across: float | None
    reason: str


def trial_order(
    cases: Collection[Case], methods: Collection[str], seeds: Collection[int]
) -> list[tuple[Case, str, int]]:
    """Return all trials: every case and method of one seed before the next seed.

    A file of a run that was cut off then has as many trials of each.
    """
    return [
        (case, method, seed) for seed in seeds for case in cases for method in methods
    ]


def grasp_once(
    case: Case, method: str, seed: int, overrides: Sequence[str] = ()
) -> Grasped:
    """Try one grasp: until the object is lifted, or the attempt has failed.

    Can, friction, mass and place are drawn from the seed, and so are the directions of
    the calibration's errors, which are the same for all methods.

    Args:
        case: What makes it hard.
        method: A key of `METHODS`.
        seed: Of the draws.
        overrides: Further settings of the scenario.
    """
    grasped = _run(grasp_scenario(case, method, seed, overrides))
    free_diagrams()
    return grasped


def grasp_scenario(
    case: Case, method: str, seed: int, overrides: Sequence[str] = ()
) -> Scenario:
    """Return the scenario of a trial; see `grasp_once`."""
    camera, settings = METHODS[method]
    scenario = load_scenario(
        SCENARIO,
        seed=seed,
        overrides=[
            *settings,
            *overrides,
            f"slides.tray.speed={case.speed}",
            f"camera_errors={{{camera}: {_errors(case, seed)}}}",
            "planner.max_attempts=1",
        ],
    )
    used = {*scenario.localizer.cameras, "hand"}
    if servo_of(scenario) is None:
        used.remove("hand")
    cameras = {name: c for name, c in scenario.cameras.items() if name in used}
    return dc.replace(scenario, cameras=cameras)


def _errors(case: Case, seed: int) -> str:
    """Return the camera's errors as YAML, in random directions."""
    translation, rotation = np.random.default_rng(seed).normal(size=(2, 3))
    translation *= case.distance / np.linalg.norm(translation)
    rotation *= case.angle / np.linalg.norm(rotation)
    return f"{{translation: {translation.tolist()}, rotation: {rotation.tolist()}}}"


def _run(scenario: Scenario) -> Grasped:
    builder, cell = MakeRoot("cell", MakeCell, AddCell, scenario, SCENARIO)
    simulator = MakeSimulator(builder.Build(), scenario.simulator_config)
    root = simulator.get_mutable_context()
    context = my_context(cell, root)
    watch = GraspWatch(scenario, cell, context)
    simulator.Initialize()
    while root.get_time() < LONGEST:
        try:
            with failure_time(SCENARIO, simulator):
                simulator.AdvanceTo(root.get_time() + 2.0 * scenario.planner.period)
        except ScenarioError:
            return watch.ended("simulation")
        grasped = watch.look(cell.GetOutputPort("planner.status").Eval(context).mode)
        if grasped is not None:
            return grasped
    return watch.ended("time")


class GraspWatch:
    """Judges a grasp by ground truth.

    Args:
        scenario: Of the grasp.
        station: With the outputs `object_poses_cheat` and `arm.state_cheat`.
        context: Of the station, with the object where it is at the start.
    """

    def __init__(self, scenario: Scenario, station: Diagram, context: Context) -> None:
        self._pick, self._context = scenario.task.pick, context
        self._poses = station.GetOutputPort("object_poses_cheat")
        self._state = station.GetOutputPort("arm.state_cheat")
        self._start = self._p_WO()[2]
        self._off: Vector | None = None
        self._previous = Mode.IDLE

    def look(self, mode: Mode) -> Grasped | None:
        """Return the end of the trial once the grasp is over.

        Args:
            mode: Of the planner, now.
        """
        if mode is Mode.CLOSE and self._previous is not Mode.CLOSE:
            arm, p_GO_planned = _hand()
            q = self._state.Eval(self._context)[: arm.n]
            self._off = arm.X_WG(q).inverse() @ self._p_WO() - p_GO_planned
        self._previous = mode
        if mode not in _OVER:
            return None
        lifted = bool(self._p_WO()[2] - self._start > _LIFTED)
        held = mode is Mode.TRANSFER and lifted
        return self.ended("" if held else _reason(mode, self._off))

    def ended(self, reason: str) -> Grasped:
        """Return the end of a trial; "" says that the object is held."""
        held, off = not reason, self._off
        if off is None:
            return Grasped(held, None, None, reason)
        norm = np.linalg.norm
        return Grasped(held, float(norm(off)), float(norm(off[1:])), reason)

    def _p_WO(self) -> Vector:
        position: Vector = self._poses.Eval(self._context)[self._pick].translation()
        return position


@functools.cache
def _hand() -> tuple[ServoArm, Vector]:
    """Return the arm, and where the object must be in the hand, shape (3,) [m]."""
    scenario = load_scenario(SCENARIO)
    name, plant = scenario.task.pick, MakeModelsPlant(scenario)
    shape = object_shape(name, scenario.objects[name])
    (grasp,) = MakeHand(scenario, plant).grasps(shape, RigidTransform())
    return ServoArm(plant), grasp.p_GO


def _reason(mode: Mode, off: Vector | None) -> str:
    if off is None:
        return "no plan" if mode is Mode.FAILED else "not reached"
    return "missed" if mode is Mode.RELEASE else "lost"
