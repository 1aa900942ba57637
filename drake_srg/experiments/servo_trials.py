"""One grasp in `kitchen_servoing`, by one way of looking."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Sequence

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from drake_srg.cell import AddCell, MakeCell
from drake_srg.cell.hands import MakeHand
from drake_srg.common.exceptions import ScenarioError
from drake_srg.lifetime import my_context
from drake_srg.objects.models import object_shape
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.servoing.arm import ServoArm
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.simulate import failure_time
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode, Vector

SCENARIO = "kitchen_servoing"
# An object that has risen this far with the hand is lifted [m], as in metrics.json.
_LIFTED = 0.015
_LONGEST = 12.0  # s
# The grasp is over, well or badly, once one of these modes begins.
_OVER = {Mode.TRANSFER, Mode.RELEASE, Mode.RETREAT, Mode.FAILED, Mode.DONE}
# Each way of looking, and the camera on which its grasp relies. Looking once is what
# `kitchen` does. Looking twice goes, without following, where the first image of the
# hand's camera shows the object by its calibration.
METHODS: dict[str, tuple[str, tuple[str, ...]]] = {
    "look once": ("ceiling", ("servoing=null",)),
    "look twice": (
        "hand",
        ("servoing.looks=1", "servoing.feed_forward=false", "servoing.goal=calibrated"),
    ),
    "pbvs": ("hand", ("servoing.method=pbvs",)),
    "ibvs": ("hand", ("servoing.method=ibvs",)),
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
    if scenario.servoing is None:
        used.remove("hand")
    cameras = {name: c for name, c in scenario.cameras.items() if name in used}
    return _run(dc.replace(scenario, cameras=cameras))


def _errors(case: Case, seed: int) -> str:
    """Return the camera's errors as YAML, in random directions."""
    translation, rotation = np.random.default_rng(seed).normal(size=(2, 3))
    translation *= case.distance / np.linalg.norm(translation)
    rotation *= case.angle / np.linalg.norm(rotation)
    return f"{{translation: {translation.tolist()}, rotation: {rotation.tolist()}}}"


def _run(scenario: Scenario) -> Grasped:
    builder, cell = MakeRoot("cell", MakeCell, AddCell, scenario, SCENARIO)
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    root = simulator.get_mutable_context()
    context = my_context(cell, root)
    arm, p_GO_planned = _hand()
    name = scenario.task.pick

    def X_WO() -> Vector:
        poses = cell.GetOutputPort("object_poses_cheat").Eval(context)
        position: Vector = poses[name].translation()
        return position

    start = X_WO()[2]
    off: Vector | None = None
    previous = Mode.IDLE
    simulator.Initialize()
    while root.get_time() < _LONGEST:
        try:
            with failure_time(SCENARIO, simulator):
                simulator.AdvanceTo(root.get_time() + 2.0 * scenario.planner.period)
        except ScenarioError:
            return _ended(False, off, "simulation")
        status = cell.GetOutputPort("planner.status").Eval(context)
        if status.mode is Mode.CLOSE and previous is not Mode.CLOSE:
            state = cell.GetOutputPort("arm.state_cheat").Eval(context)
            off = arm.X_WG(state[: arm.n]).inverse() @ X_WO() - p_GO_planned
        previous = status.mode
        if status.mode in _OVER:
            lifted = bool(X_WO()[2] - start > _LIFTED)
            held = status.mode is Mode.TRANSFER and lifted
            return _ended(held, off, "" if held else _reason(status.mode, off))
    return _ended(False, off, "time")


@functools.cache
def _hand() -> tuple[ServoArm, Vector]:
    """Return the arm, and where the object must be in the hand, shape (3,) [m]."""
    scenario = load_scenario(SCENARIO)
    name, plant = scenario.task.pick, MakeModelsPlant(scenario)
    shape = object_shape(name, scenario.objects[name])
    (grasp,) = MakeHand(scenario, plant).grasps(shape, np.array([0.0, 0.0, 1.0]))
    return ServoArm(plant), grasp.p_GO


def _reason(mode: Mode, off: Vector | None) -> str:
    if off is None:
        return "no plan" if mode is Mode.FAILED else "not reached"
    return "missed" if mode is Mode.RELEASE else "lost"


def _ended(held: bool, off: Vector | None, reason: str) -> Grasped:
    if off is None:
        return Grasped(held, None, None, reason)
    norm = np.linalg.norm
    return Grasped(held, float(norm(off)), float(norm(off[1:])), reason)
