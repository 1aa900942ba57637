"""Checks of a scenario, and the expansion of its `task.pick`."""

from __future__ import annotations

import dataclasses as dc
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pydrake.multibody.parsing import ModelDirective
from pydrake.systems.sensors import CameraConfig

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.common.systems import contact_approximations
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.disturber import Topple
from drake_srg.scenario.planner import planner_problems
from drake_srg.scenario.schema import RobotArm, Scenario, robot_arms
from drake_srg.scenario.typed_yaml import describe, fail
from drake_srg.theses.script import Script
from drake_srg.types import Box
from drake_srg.vision.color import COLORS

_ALL, _ROW = "all", "row"
_ALLOWED = "all, a list of names, {colour: COLOUR}"


def resolve_pick(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return a scenario's tree with explicit bins and selections.

    `task.pick` with `task.place.bin` becomes an entry of `task.place.bins`.
    `task.clear.objects` gets the names of all objects for the bins or the row.

    Args:
        tree: Tree of the whole scenario, with its clutter; not changed.
        origin: File or name at the start of error messages.

    Raises:
        ScenarioError: If `task.pick` and `task.place` do not go together, or if
            `task.clear` names objects itself.
    """
    task, objects = tree.get("task"), tree.get("objects")
    if not (isinstance(task, Mapping) and isinstance(objects, Mapping)):
        return tree  # `load_typed` reports it
    pick, clear = task.get("pick"), task.get("clear")
    place = task.get("place")
    if not isinstance(place, Mapping):
        place = {}  # `load_typed` reports any other type
    given = [key for key in ("bin", "bins") if place.get(key)]
    if place.get("row") is not None:  # {} is a row with the defaults
        given.append("row")
    if not given:
        return _without_bin(tree, origin)
    if len(given) > 1:
        problem = f"needs one of bin, bins and row, got {' and '.join(given)}"
        fail(origin, "task.place", problem)
    bins = _bins(pick, place, objects, origin)
    if not isinstance(bins, Mapping):
        return tree  # `load_typed` reports it
    clear = {} if clear is None else clear
    if not isinstance(clear, Mapping):
        return tree  # `load_typed` reports it
    if "objects" in clear:
        fail(origin, "task.clear.objects", "must be absent: task.pick sets it")
    named = [selection.get("names") for selection in bins.values()]
    every = [name for name in objects if _present(objects[name])]
    if all(isinstance(names, list) for names in named):
        every = [name for names in named for name in names]
    clear = {**clear, "objects": every}
    place = {**place, "bins": {} if "row" in given else bins}
    return {**tree, "task": {**task, "pick": "", "clear": clear, "place": place}}


def _bins(
    pick: Any, place: Mapping[str, Any], objects: Mapping[str, Any], origin: str
) -> Any:
    """Return the selection of each bin or of the row, as trees of SelectionConfig."""
    into, bins = place.get("bin"), place.get("bins")
    if into and not isinstance(into, str):
        fail(origin, "task.place.bin", f"must be text, got {_shown(into)}")
    if place.get("row") is not None and not isinstance(pick, list):
        problem = f"must be a list of names with task.place.row, got {_shown(pick)}"
        fail(origin, "task.pick", problem)
    if not bins:
        return {into or _ROW: _selection(pick, objects, origin, "task.pick")}
    if pick != _ALL:
        problem = f"must be all with task.place.bins, got {_shown(pick)}"
        fail(origin, "task.pick", problem)
    if not isinstance(bins, Mapping):
        return bins
    return {
        name: _selection(given, objects, origin, f"task.place.bins.{name}")
        for name, given in bins.items()
    }


def _without_bin(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return the tree of a scenario without bins, with its one object as text."""
    task, pick = tree["task"], tree["task"].get("pick")
    if pick == _ALL and _ALL not in tree["objects"]:
        fail(origin, "task.place.bin", "must name the bin where `all` are picked")
    if isinstance(pick, Mapping):
        fail(origin, "task.place.bin", "must name the bin for objects of a colour")
    if not isinstance(pick, list):
        return tree
    if len(pick) != 1:
        problem = f"must name one object without task.place.bin, got {len(pick)}"
        fail(origin, "task.pick", problem)
    return {**tree, "task": {**task, "pick": pick[0]}}


def _selection(
    given: Any, objects: Mapping[str, Any], origin: str, key: str
) -> Mapping[str, Any]:
    """Return the selection of `task.pick` or a bin: a tree of SelectionConfig."""
    if given == _ALL and _ALL not in objects:
        return {}
    if isinstance(given, str):
        if given not in objects:
            allowed = suggest(given, [_ALL, *objects])
            fail(origin, key, f"unknown object {given!r} {allowed}")
        given = [given]
    if isinstance(given, list):
        if not given:
            fail(origin, key, "must name at least one object")
        for i, name in enumerate(given):
            if not (isinstance(name, str) and name in objects):
                allowed = suggest(str(name), objects)
                fail(origin, key, f"unknown object {_shown(name)} {allowed}")
            if name in given[:i]:
                fail(origin, key, f"must name each object once, got {name!r} again")
        return {"names": given}
    if not (isinstance(given, Mapping) and given.get("colour")):
        fail(origin, key, f"must be one of: {_ALLOWED}, got {_shown(given)}")
    if (colour := given["colour"]) not in COLORS:
        known = suggest(str(colour), COLORS)
        fail(origin, f"{key}.colour", f"unknown {_shown(colour)} {known}")
    return given


def _present(given: Any) -> bool:
    return not (isinstance(given, Mapping) and given.get("present") is False)


def _shown(given: Any) -> str:
    return repr(given) if isinstance(given, str) else describe(given)


def clear_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key and the description of each problem with clearing the table."""
    clear, table = scenario.task.clear, scenario.table
    if clear is None:
        if scenario.task.place.cameras:
            yield "task.place.cameras", "needs task.place.bin, bins or row"
        return
    if not clear.objects:
        yield "task.pick", "needs at least one object for the bin, got none"
    yield from _bin_problems(scenario)
    low, high = clear.region.min, clear.region.max
    if any(a >= b for a, b in zip(low, high, strict=True)):
        yield "task.clear.region", f"min must be below max, got {low} .. {high}"
    if any(a > b for a, b in zip(table.min, low, strict=True)) or any(
        a > b for a, b in zip(high, table.max, strict=True)
    ):
        yield (
            "task.clear.region",
            f"must be on the table, got {low} .. {high} "
            f"(allowed: {table.min} .. {table.max})",
        )


def _bin_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield missing bins, and labels that the cameras cannot tell apart."""
    added = [d.add_model.name for d in scenario.directives if d.add_model is not None]
    arms = robot_arms(scenario)
    moving = {*(a.arm_model for a in arms), *(a.gripper_model for a in arms)}
    models = [name for name in added if name not in moving]
    place = scenario.task.place
    taken: dict[str, str] = {}  # bin by name or colour
    for name, selection in place.bins.items():
        key = "task.place.bin" if place.bin else f"task.place.bins.{name}"
        if name not in models:
            yield key, f"unknown model {name!r} {suggest(name, models)}"
        if selection.names and selection.colour:
            yield key, "needs either names or a colour"
        for thing in selection.names or [selection.colour or _ALL]:
            if thing in taken and not scenario.arms:
                yield key, f"must not take {thing!r}, which {taken[thing]!r} takes"
            taken[thing] = name
        for thing in selection.names:
            if not scenario.objects[thing].known:
                yield f"objects.{thing}.known", "must be true for an object with a name"


# Kinds of model directives, by the key of an entry.
_DIRECTIVES = sorted(k for k in dir(ModelDirective()) if k.startswith("add_"))
# Drake's name of the only integrator that supports stiff contact and PD actuators.
_CENIC = "cenic"


def check_scenario(scenario: Scenario, origin: str) -> None:
    """Check that fields are consistent, and that no number would crash Drake.

    Args:
        scenario: A loaded scenario, before positions are drawn.
        origin: File or name at the start of error messages.

    Raises:
        ScenarioError: On the first mistake found.
    """
    for key, problem in _problems(scenario):
        raise ScenarioError(f"{origin}: {key}: {problem}")


def _problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key and the description of each problem."""
    yield from _config_problems(scenario)
    yield from _step_problems(scenario)
    yield from _arms_problems(scenario)
    for robot in robot_arms(scenario):
        yield from _gripper_problems(robot)
    yield from _pick_problems(scenario)
    for name, config in scenario.objects.items():
        yield from _object_problems(scenario, f"objects.{name}", config)
    yield from _sleeping_problems(scenario)
    yield from clear_problems(scenario)
    yield from _region_problems(scenario)
    yield from planner_problems(scenario)
    yield from _disturbance_problems(scenario)
    yield from _camera_problems(scenario)


def _config_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the problems of Drake's own settings."""
    plant, simulator = scenario.plant_config, scenario.simulator_config
    for key, value in (
        # Drake aborts the process on invalid values of these two.
        ("plant_config.penetration_allowance", plant.penetration_allowance),
        ("plant_config.stiction_tolerance", plant.stiction_tolerance),
        ("simulator_config.accuracy", simulator.accuracy),
        ("simulator_config.max_step_size", simulator.max_step_size),
    ):
        if not value > 0.0:
            yield key, f"must be greater than 0.0, got {value}"
    name, known = plant.discrete_contact_approximation, contact_approximations()
    if name not in known:
        key = "plant_config.discrete_contact_approximation"
        yield key, f"unknown {name!r} (allowed: {', '.join(known)})"
    if (start := simulator.start_time) != 0.0:  # every run starts at 0
        yield "simulator_config.start_time", f"must be 0.0, got {start}"
    for i, pair in enumerate(scenario.ignored_contacts):
        if len(pair) != 2:
            yield f"ignored_contacts[{i}]", f"needs 2 names, got {len(pair)}"
    for i, directive in enumerate(scenario.directives):
        kinds = [k for k in _DIRECTIVES if getattr(directive, k) is not None]
        if len(kinds) != 1:  # Drake would ignore all but one
            got = " and ".join(kinds) or "none"
            yield (
                f"directives[{i}]",
                f"needs one of {', '.join(_DIRECTIVES)}; got {got}",
            )


def _step_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield problems with the plant's time step and the integrator."""
    step = scenario.plant_config.time_step
    scheme = scenario.simulator_config.integration_scheme
    if not (step > 0.0 or (step == 0.0 and scheme == _CENIC)):
        yield (
            "plant_config.time_step",
            f"must be greater than 0.0, or 0.0 with integrator {_CENIC}, got {step}",
        )
    if step > 0.0:
        if scheme == _CENIC:
            yield (
                "simulator_config.integration_scheme",
                f"{_CENIC} needs plant_config.time_step 0.0, got {step}",
            )
        return
    # On a continuous plant, objects held by a tendon driver creep (docs/speed.md).
    for robot in robot_arms(scenario):
        driver = robot.gripper
        if driver is not None and driver.needs_discrete_plant:
            tag = f"!{type(driver).__name__}"
            problem = f"{tag} cannot be used with integrator {_CENIC}"
            yield f"{robot.key}gripper", problem
    for key, period in _periods(scenario):
        # Multiples of 1/1024 s are exact in binary. 1024 periods of 10 ms, however,
        # miss 10.24 s by a rounding error. Drake 1.51.1 and 1.58 then take a step that
        # short, in which contact fails (docs/speed.md).
        if not (1024.0 * period).is_integer():
            problem = f"must be a multiple of 1/1024 s with {_CENIC}, got {period}"
            yield key, problem
    for name, config in scenario.objects.items():
        if config.soft:
            yield f"objects.{name}.soft", f"must be null with integrator {_CENIC}"


def _periods(scenario: Scenario) -> Iterator[tuple[str, float]]:
    """Yield the keys and periods [s] of all periodic events."""
    yield "recording.period", scenario.recording.period
    yield "recording.bag_camera_period", scenario.recording.bag_camera_period
    yield "recording.video_fps", 1.0 / scenario.recording.video_fps
    if scenario.twin.period is not None:
        yield "twin.period", scenario.twin.period
    planner = () if isinstance(scenario.planner, Script) else ("planner", "localizer")
    for robot in robot_arms(scenario):
        yield from _periods_of(f"{robot.key}arm", robot.arm)
        yield from _periods_of(f"{robot.key}gripper", robot.gripper)
    for key in planner:
        yield from _periods_of(key, getattr(scenario, key))


def _periods_of(key: str, config: object) -> Iterator[tuple[str, float]]:
    if dc.is_dataclass(config):
        for field in dc.fields(config):
            value = getattr(config, field.name)
            if field.name in ("period", "camera_period"):
                yield f"{key}.{field.name}", value
            else:
                yield from _periods_of(f"{key}.{field.name}", value)


# Names that an arm must not have, because ports and models have them.
_TAKEN = ("arm", "gripper", "safety", "planner", "localizer", "station", "object")


def _arms_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the problems of `arms`, such as invalid names or an `arm` beside it."""
    if not scenario.arms:
        return
    for key in ("arm", "gripper", "safety"):
        if getattr(scenario, key) is not None:
            problem = f"must be null with arms ({', '.join(scenario.arms)})"
            yield key, f"{problem}: write arms.NAME.{key}"
    for name, each in scenario.arms.items():
        if not re.fullmatch("[a-z][a-z0-9_]*", name) or name in _TAKEN:
            allowed = f"lower case letters, digits and _; not {', '.join(_TAKEN)}"
            yield f"arms.{name}", f"must have another name (allowed: {allowed})"
        if each.arm is None:
            yield f"arms.{name}.arm", "must be given"


def _gripper_problems(robot: RobotArm) -> Iterator[tuple[str, str]]:
    driver, key = robot.gripper, f"{robot.key}gripper"
    if driver is None:
        return
    if driver.trigger not in driver.sensors():
        yield (
            f"{key}.trigger",
            f"must name a sensor, got {driver.trigger!r} "
            f"(allowed: {', '.join(driver.sensors())})",
        )
    for gain in ("kp", "ki", "kd", "kff1", "kff2"):
        count = len(getattr(driver.servo, gain))
        if count != driver.num_motors:
            problem = f"needs one entry per motor ({driver.num_motors}), got {count}"
            yield f"{key}.servo.{gain}", problem


def _pick_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    pick = scenario.task.pick
    if pick not in ("", *scenario.objects):
        allowed = ", ".join(scenario.objects) or "none"
        yield "task.pick", f"unknown object {pick!r} (allowed: {allowed})"


def _object_problems(
    scenario: Scenario, key: str, config: ObjectConfig
) -> Iterator[tuple[str, str]]:
    if (config.model is None) == (config.shape is None):
        yield key, "needs either a model or a shape"
    if config.shape is not None and None in (config.mass, config.friction):
        yield key, "an object with a shape needs mass and friction"
    if config.soft is not None and not isinstance(config.shape, Box):
        yield f"{key}.soft", "needs a shape (allowed: !Box)"
    if config.shape is not None and config.pose is None:
        (x0, y0), (x1, y1) = scenario.table.min, scenario.table.max
        width, depth = config.shape.bounding_size[:2]
        table = (x1 - x0, y1 - y0)
        if max(table) > 0.0 and (width > table[0] or depth > table[1]):
            yield (
                f"{key}.shape",
                f"must fit on the table, got {width:g} x {depth:g} m "
                f"(allowed: up to {table[0]:g} x {table[1]:g} m)",
            )
    has_place = config.position is not None or config.yaw or config.drop is not None
    if config.pose is not None and has_place:
        yield key, "needs either a pose, or position, yaw and drop"
    if any(config.tilt) and config.drop is None:
        yield f"{key}.tilt", "needs drop: a tilted object does not stand"
    if config.drop is not None and config.soft is not None:
        yield f"{key}.drop", "must be null for a soft object"
    if config.position is not None:
        (x0, y0), (x1, y1) = scenario.table.min, scenario.table.max
        x, y = config.position
        if not (x0 <= x <= x1 and y0 <= y <= y1):
            yield (
                f"{key}.position",
                f"must be on the table, got {config.position} "
                f"(allowed: x {x0} .. {x1}, y {y0} .. {y1})",
            )


def _sleeping_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the problems of `sleeping`, if it is given."""
    if scenario.sleeping is None:
        return
    step, period = scenario.plant_config.time_step, scenario.sleeping.period
    if step == 0.0:  # Drake locks joints of discrete plants only
        yield "sleeping", f"must be null with integrator {_CENIC}"
    elif period < step:
        problem = (
            f"must be at least plant_config.time_step ({step:g} s), got {period:g}"
        )
        yield "sleeping.period", problem
    if any(config.soft for config in scenario.objects.values()):
        yield "sleeping", "must be null with soft objects"


def _region_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the problems of `task.region`, if it is used."""
    objects = scenario.objects.values()
    if all(obj.position is not None or obj.pose is not None for obj in objects):
        return
    region, table = scenario.task.region, scenario.table
    if any(a > b for a, b in zip(region.min, region.max, strict=True)):
        problem = f"min must not be above max, got {region.min} .. {region.max}"
        yield "task.region", problem
    if any(a > b for a, b in zip(table.min, region.min, strict=True)) or any(
        a > b for a, b in zip(region.max, table.max, strict=True)
    ):
        yield (
            "task.region",
            f"must be on the table, got {region.min} .. {region.max} "
            f"(allowed: {table.min} .. {table.max})",
        )


def _disturbance_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    rigid = ", ".join(n for n, o in scenario.objects.items() if not o.soft) or "none"
    script = scenario.planner if isinstance(scenario.planner, Script) else None
    modes = sorted({step.mode for step in script.steps}) if script else []
    for i, disturbance in enumerate(scenario.disturbances):
        key = f"disturbances[{i}]"
        name = disturbance.object or scenario.task.pick
        config = scenario.objects.get(name)
        if config is None or config.soft:
            problem = f"must be a rigid object, got {name!r} (allowed: {rigid})"
            yield f"{key}.object", problem
        if script and disturbance.at not in modes:
            yield (
                f"{key}.at",
                f"must be a mode of the script, got {disturbance.at!r} "
                f"(allowed: {', '.join(modes)})",
            )
        if isinstance(disturbance, Topple) and not any(disturbance.direction):
            yield f"{key}.direction", "must not be [0, 0]"


def _camera_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    for name, camera in scenario.cameras.items():
        for side in ("width", "height"):
            size = getattr(camera, side)
            if size < 1:
                yield f"cameras.{name}.{side}", f"must be at least 1 pixel, got {size}"
        if isinstance(camera.focal, CameraConfig.FovDegrees):
            for axis in ("x", "y"):
                angle = getattr(camera.focal, axis)
                if angle is not None and not 0.0 < angle < 180.0:
                    yield (
                        f"cameras.{name}.focal.{axis}",
                        f"must be between 0 and 180 degrees, got {angle}",
                    )
    allowed = ", ".join(scenario.cameras) or "none"
    video = scenario.recording.video_camera
    inset = scenario.recording.inset_camera if video else ""
    for key, used in (
        ("camera_errors", list(scenario.camera_errors)),
        ("camera_calibrations", list(scenario.camera_calibrations)),
        ("localizer.cameras", scenario.localizer.cameras),
        ("task.place.cameras", scenario.task.place.cameras),
        ("recording.bag_cameras", scenario.recording.bag_cameras),
        ("recording.video_camera", [video] if video else []),
        ("recording.inset_camera", [inset] if inset else []),
    ):
        for camera in used:
            if camera not in scenario.cameras:
                yield key, f"unknown camera {camera!r} (allowed: {allowed})"
        if len(set(used)) != len(used):
            yield key, f"must name each camera once, got [{', '.join(used)}]"
