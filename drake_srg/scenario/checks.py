"""What is checked of a scenario as a whole, beyond the content of its fields."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from pydrake.systems.sensors import CameraConfig

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.disturbances import Topple
from drake_srg.types import Box

if TYPE_CHECKING:
    from drake_srg.scenario.schema import Scenario

# Drake's name of the only integrator that takes stiff contact and PD actuators.
_CENIC = "cenic"


def check_scenario(scenario: Scenario, origin: str) -> None:
    """Check what one field alone cannot tell.

    Args:
        scenario: As loaded, before positions are drawn.
        origin: File or name to begin errors with.

    Raises:
        ScenarioError: On the first thing that is wrong.
    """

    def require(condition: bool, key: str, message: str) -> None:
        if not condition:
            raise ScenarioError(f"{origin}: {key}: {message}")

    # Of these Drake makes a program's end.
    for name in ("penetration_allowance", "stiction_tolerance"):
        value = getattr(scenario.plant_config, name)
        message = f"must be greater than 0.0, is {value}"
        require(value > 0.0, f"plant_config.{name}", message)
    _check_steps(scenario, require)
    if scenario.gripper is not None:
        sensors = ", ".join(scenario.gripper.sensors())
        trigger = scenario.gripper.trigger
        message = f"must name a sensor, got {trigger!r} (allowed: {sensors})"
        require(trigger in scenario.gripper.sensors(), "gripper.trigger", message)
        motors = scenario.gripper.num_motors
        for gain in ("kp", "ki", "kd", "kff1", "kff2"):
            values = getattr(scenario.gripper.servo, gain)
            message = f"must have an entry a motor, {motors}, has {len(values)}"
            require(len(values) == motors, f"gripper.servo.{gain}", message)
    for name in ("accuracy", "max_step_size"):
        value = getattr(scenario.simulator_config, name)
        message = f"must be greater than 0.0, is {value}"
        require(value > 0.0, f"simulator_config.{name}", message)
    start = scenario.simulator_config.start_time
    message = f"must be 0.0, when every run starts, is {start}"
    require(start == 0.0, "simulator_config.start_time", message)
    names = ", ".join(scenario.objects) or "none"
    pick = scenario.task.pick
    require(
        pick in ("", *scenario.objects),
        "task.pick",
        f"{pick!r} is not among the objects; allowed: {names}",
    )
    for name, obj in scenario.objects.items():
        key = f"objects.{name}"
        require(
            (obj.model is None) != (obj.shape is None),
            key,
            "needs either a model or a shape",
        )
        require(
            obj.model is not None or None not in (obj.mass, obj.friction),
            key,
            "an object with a shape needs mass and friction",
        )
        require(
            obj.soft is None or isinstance(obj.shape, Box),
            f"{key}.soft",
            "needs a shape; allowed: !Box",
        )
        require(
            obj.pose is None or (obj.position is None and obj.yaw == 0.0),
            key,
            "needs either a pose or position and yaw",
        )
        if obj.position is not None:
            low, high = scenario.table.min, scenario.table.max
            require(
                all(
                    a <= x <= b for x, a, b in zip(obj.position, low, high, strict=True)
                ),
                f"{key}.position",
                f"{obj.position} is not on the table; "
                f"allowed: x {low[0]} .. {high[0]}, y {low[1]} .. {high[1]}",
            )
    if any(
        obj.position is None and obj.pose is None for obj in scenario.objects.values()
    ):
        region, table = scenario.task.region, scenario.table
        require(
            all(a <= b for a, b in zip(region.min, region.max, strict=True)),
            "task.region",
            f"min must not be above max, is {region.min} .. {region.max}",
        )
        require(
            all(a <= b for a, b in zip(table.min, region.min, strict=True))
            and all(a <= b for a, b in zip(region.max, table.max, strict=True)),
            "task.region",
            f"must be on the table; allowed: {table.min} .. {table.max}",
        )
    for i, pair in enumerate(scenario.ignored_contacts):
        message = f"must be a pair of names, has {len(pair)} entries"
        require(len(pair) == 2, f"ignored_contacts[{i}]", message)
    duration = sum(step.duration for step in scenario.script)
    budget = scenario.planner.time_budget
    message = f"takes {duration:g} s; allowed: planner.time_budget, {budget:g} s"
    require(duration <= budget, "script", message)
    for i, step in enumerate(scenario.script):
        n = len(scenario.arm.home) if scenario.arm else 0
        require(
            step.arm is None or len(step.arm) == n,
            f"script[{i}].arm",
            f"must have an entry a joint of the arm, {n}, has {len(step.arm or [])}",
        )
    _check_disturbances(scenario, require)
    _check_cameras(scenario, require)


def _check_steps(scenario: Scenario, require: Callable[[bool, str, str], None]) -> None:
    step = scenario.plant_config.time_step
    scheme = scenario.simulator_config.integration_scheme
    message = f"must be greater than 0.0, or 0.0 for integrator {_CENIC}, is {step}"
    fits = step > 0.0 or (step == 0.0 and scheme == _CENIC)
    require(fits, "plant_config.time_step", message)
    # It is updated as often as the plant, and what it holds creeps (docs/speed.md).
    driver = scenario.gripper
    discrete = driver is not None and driver.needs_discrete_plant
    message = f"!{type(driver).__name__} cannot be used with integrator {_CENIC}"
    require(step > 0.0 or not discrete, "gripper", message)
    if step == 0.0:
        for key, period in _periods(scenario):
            # 1024 periods of 10 ms are not 10.24 s, but a rounding error beside it.
            message = f"must be a multiple of 1/1024 s with {_CENIC}, is {period}"
            require((1024.0 * period).is_integer(), key, message)
    message = f"{_CENIC} needs plant_config.time_step 0.0, which is {step}"
    key = "simulator_config.integration_scheme"
    require(step == 0.0 or scheme != _CENIC, key, message)
    for name, config in scenario.objects.items():
        message = f"cannot be soft with integrator {_CENIC}"
        require(step > 0.0 or not config.soft, f"objects.{name}", message)


def _periods(scenario: Scenario) -> Iterator[tuple[str, float]]:
    """Keys and periods [s] of all events."""
    yield "recording.period", scenario.recording.period
    yield "recording.bag_camera_period", scenario.recording.bag_camera_period
    yield "recording.video_fps", 1.0 / scenario.recording.video_fps
    planner = () if scenario.script else ("planner", "localizer")
    for key in ("arm", "gripper", *planner):
        yield from _periods_of(key, getattr(scenario, key))


def _periods_of(key: str, config: object) -> Iterator[tuple[str, float]]:
    if dc.is_dataclass(config):
        for field in dc.fields(config):
            value = getattr(config, field.name)
            if field.name == "period":
                yield f"{key}.period", value
            else:
                yield from _periods_of(f"{key}.{field.name}", value)


def _check_disturbances(
    scenario: Scenario, require: Callable[[bool, str, str], None]
) -> None:
    rigid = ", ".join(n for n, o in scenario.objects.items() if not o.soft) or "none"
    modes = sorted({step.mode for step in scenario.script})
    for i, disturbance in enumerate(scenario.disturbances):
        key = f"disturbances[{i}]"
        name = disturbance.object or scenario.task.pick
        config = scenario.objects.get(name)
        message = f"{name!r} is not an object, or soft; allowed: {rigid}"
        require(config is not None and not config.soft, f"{key}.object", message)
        message = f"the script has no step {disturbance.at!r}; allowed: "
        scripted = not scenario.script or disturbance.at in modes
        require(scripted, f"{key}.at", message + ", ".join(modes))
        if isinstance(disturbance, Topple):
            message = "must not be [0, 0]"
            require(any(disturbance.direction), f"{key}.direction", message)


def _check_cameras(
    scenario: Scenario, require: Callable[[bool, str, str], None]
) -> None:
    for name, camera in scenario.cameras.items():
        for side in ("width", "height"):
            size = getattr(camera, side)
            message = f"must be at least 1 pixel, is {size}"
            require(size >= 1, f"cameras.{name}.{side}", message)
        if isinstance(camera.focal, CameraConfig.FovDegrees):
            for axis in ("x", "y"):
                angle = getattr(camera.focal, axis)
                require(
                    angle is None or 0.0 < angle < 180.0,
                    f"cameras.{name}.focal.{axis}",
                    f"must be between 0 and 180 degrees, is {angle}",
                )
    allowed = ", ".join(scenario.cameras) or "none"
    video = scenario.recording.video_camera
    for key, used in (
        ("camera_errors", list(scenario.camera_errors)),
        ("localizer.cameras", scenario.localizer.cameras),
        ("recording.bag_cameras", scenario.recording.bag_cameras),
        ("recording.video_camera", [video] if video else []),
    ):
        for camera in used:
            message = f"{camera!r} is not among the cameras; allowed: {allowed}"
            require(camera in scenario.cameras, key, message)
        message = f"must name each camera once, is [{', '.join(used)}]"
        require(len(set(used)) == len(used), key, message)
