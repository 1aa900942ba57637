"""Tags and checks of a scenario's planner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from drake_srg.arm.impedance import ArmImpedanceDriver
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.planning.handover.config import Handover
from drake_srg.planning.insertion.config import Insert
from drake_srg.planning.planner_machine import (
    SEARCH_PERIOD,
    Clear,
    PickAndPlace,
)
from drake_srg.planning.servoing.config import Servoing, WindowConfig
from drake_srg.scenario.typed_yaml import fail
from drake_srg.theses.script import Script
from drake_srg.theses.taught import Taught

if TYPE_CHECKING:
    from drake_srg.scenario.schema import Scenario

# Keys of files from before planners had tags, and their present form.
_EARLIER = {
    "taught": "planner: !Taught {lift: [...], place: [...], ...}",
    "servoing": "planner: !Servoing {servo: {...}, ...}",
    "script": "planner: !Script {steps: [...]}",
    "messages": "planner: !Script {messages: {...}}",
}


def with_planner_tag(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return a scenario's tree with a planner's tag, by default `!PickAndPlace`.

    Args:
        tree: The tree, with bases and overrides.
        origin: File or name at the start of error messages.

    Raises:
        ScenarioError: If the tree has a key from before planners had tags.
    """
    for key, form in _EARLIER.items():
        if key in tree:
            fail(origin, key, f"is a key of the planner now: write {form}")
    planner = tree.get("planner")
    if not isinstance(planner, Mapping) or "_tag" in planner:
        return tree
    return {**tree, "planner": {**planner, "_tag": f"!{PickAndPlace.__name__}"}}


def planner_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key and the description of each problem of `planner`."""
    yield from _task_problems(scenario)
    planner = scenario.planner
    if isinstance(planner, Script):
        yield from _script_problems(scenario, planner)
    if isinstance(planner, Taught) and scenario.localizer.obstacles:
        problem = "must be false with taught waypoints, which avoid no obstacles"
        yield "localizer.obstacles", f"{problem}, got true"
    if isinstance(planner, Servoing):
        yield from _servo_problems(scenario, planner)
    if isinstance(planner, Insert):
        yield from _insertion_problems(scenario, planner)
    if isinstance(planner, Handover):
        yield from _handover_problems(scenario, planner)
    if isinstance(planner, CarryTogether):
        yield from _carry_problems(scenario, planner)
    if isinstance(planner, Clear) and scenario.arms:
        yield from _clear_together_problems(scenario)


# Configurations of planners that take one object, named by `task.pick`.
_ONE_OBJECT = (PickAndPlace, Servoing, Insert, Handover, CarryTogether, Taught)


def _task_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    kind, clears = type(scenario.planner), scenario.task.clear is not None
    if clears and kind in _ONE_OBJECT:
        problem = (
            f"must have the tag !{Clear.__name__} with this task.pick, got "
            f"!{kind.__name__}: write planner: !{Clear.__name__} {{...}}"
        )
        yield "planner", problem
    if isinstance(scenario.planner, Clear) and not clears:
        problem = (
            f"must be all, a colour or a list of names with planner: "
            f"!{kind.__name__}, got {scenario.task.pick!r}"
        )
        yield "task.pick", problem


def _script_problems(scenario: Scenario, planner: Script) -> Iterator[tuple[str, str]]:
    duration, budget = sum(step.duration for step in planner.steps), planner.time_budget
    if duration > budget:
        problem = f"must last at most planner.time_budget ({budget:g} s)"
        yield "planner.steps", f"{problem}, got {duration:g} s"
    n = len(scenario.arm.home) if scenario.arm else 0
    for i, step in enumerate(planner.steps):
        if step.arm is not None and len(step.arm) != n:
            yield (
                f"planner.steps[{i}].arm",
                f"needs one entry per joint of the arm ({n}), got {len(step.arm)}",
            )


def _insertion_problems(
    scenario: Scenario, planner: Insert
) -> Iterator[tuple[str, str]]:
    if scenario.task.repeat > 1:
        problem = "must be 1 with planner: !Insert, which takes no peg out of its hole"
        yield "task.repeat", f"{problem}, got {scenario.task.repeat}"
    arm = scenario.arm
    if not isinstance(arm, ArmImpedanceDriver) or arm.cartesian is None:
        problem = "must be !ArmImpedanceDriver with cartesian for planner: !Insert"
        yield "arm", f"{problem}, got !{type(arm).__name__}"
        return
    # The planner keeps its force limits only if it knows the arm's stiffness.
    stiffest = max(arm.cartesian.translation), arm.cartesian.rotation
    for key, actual in zip(("stiffness", "turning_stiffness"), stiffest, strict=True):
        if (assumed := getattr(planner, key)) != actual:
            problem = f"must be that of arm.cartesian ({actual:g}), got {assumed:g}"
            yield f"planner.{key}", problem


def _handover_problems(
    scenario: Scenario, planner: Handover
) -> Iterator[tuple[str, str]]:
    if scenario.task.repeat > 1:
        problem = "must be 1 with planner: !Handover, which gives one way only"
        yield "task.repeat", f"{problem}, got {scenario.task.repeat}"
    yield from _two_arm_problems(scenario, planner, "giver", "receiver")


def _carry_problems(
    scenario: Scenario, planner: CarryTogether
) -> Iterator[tuple[str, str]]:
    yield from _two_arm_problems(scenario, planner, "first", "second")
    for key in (planner.first, planner.second):
        arm = scenario.arms.get(key)
        if arm is not None and arm.gripper is None:
            yield f"arms.{key}.gripper", "must be given with planner: !CarryTogether"
        if arm is not None and not isinstance(arm.arm, ArmImpedanceDriver):
            problem = "must be !ArmImpedanceDriver for planner: !CarryTogether, or the "
            problem += "arms press against each other"
            yield f"arms.{key}.arm", f"{problem}, got !{type(arm.arm).__name__}"
    if planner.max_external_torque is not None:
        problem = "must be null with planner: !CarryTogether, which watches no torques"
        yield "planner.max_external_torque", problem


def _clear_together_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    tag = f"planner: !{Clear.__name__} and arms"
    if len(scenario.arms) > 2:
        got = ", ".join(scenario.arms)
        yield "arms", f"must be one or two with planner: !{Clear.__name__}, got {got}"
    for name, each in scenario.arms.items():
        if each.gripper is None:
            yield f"arms.{name}.gripper", f"must be given with {tag}"
    if not scenario.task.place.bins:
        yield "task.place.bins", f"must have a bin for each arm with {tag}, got none"
    for name, selection in scenario.task.place.bins.items():
        if selection.names or selection.colour:
            got = selection.colour or ", ".join(selection.names)
            yield f"task.place.bins.{name}", f"must be all with {tag}, got {got}"


def _two_arm_problems(
    scenario: Scenario, planner: Handover | CarryTogether, first: str, second: str
) -> Iterator[tuple[str, str]]:
    """Yield the problems of a planner that names two arms at these keys."""
    tag = type(planner).__name__
    allowed = ", ".join(scenario.arms) or "none"
    for key in (first, second):
        if (name := getattr(planner, key)) not in scenario.arms:
            yield f"planner.{key}", f"unknown arm {name!r} (allowed: {allowed})"
    if (name := getattr(planner, first)) == getattr(planner, second):
        yield f"planner.{second}", f"must not be the {first}, {name!r}"
    sizes = {len(each.arm.home) for each in scenario.arms.values() if each.arm}
    if len(sizes) > 1:
        problem = f"must have as many joints each with planner: !{tag}"
        yield "arms", f"{problem}, got {', '.join(map(str, sorted(sizes)))}"


def _window_problems(
    scenario: Scenario, planner: Servoing, window: WindowConfig
) -> Iterator[tuple[str, str]]:
    corners = {"min": window.min, "max": window.max}
    short = [key for key, corner in corners.items() if len(corner) != 2]
    for key in short:
        yield f"planner.window.{key}", f"must be [x, y], got {corners[key]}"
    if not short and any(a >= b for a, b in zip(window.min, window.max, strict=True)):
        problem = f"min must be below max, got {window.min} .. {window.max}"
        yield "planner.window", problem
    if planner.search_time <= SEARCH_PERIOD:
        problem = f"must be above {SEARCH_PERIOD:g} s, to look twice"
        yield "planner.search_time", f"{problem}, got {planner.search_time:g}"
    if scenario.task.repeat > 1:
        problem = "must be 1 with planner.window, because the goal is outside it"
        yield "task.repeat", f"{problem}, got {scenario.task.repeat}"


def _servo_problems(scenario: Scenario, planner: Servoing) -> Iterator[tuple[str, str]]:
    servo = planner.servo
    if servo.camera not in scenario.cameras:
        allowed = ", ".join(scenario.cameras) or "none"
        problem = f"unknown camera {servo.camera!r} (allowed: {allowed})"
        yield "planner.servo.camera", problem
    if planner.window is not None:
        yield from _window_problems(scenario, planner, planner.window)
    images = servo.camera_period / servo.period
    if images < 1.0 or abs(images - round(images)) > 1e-6:
        yield (
            "planner.servo.camera_period",
            f"must be a multiple of planner.servo.period ({servo.period:g} s), "
            f"got {servo.camera_period:g}",
        )
