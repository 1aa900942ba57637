"""A station that a script commands directly: benches, tables, drops.

For example::

    scenario = bench_scenario(household_objects()["056_tennis_ball"])
    with Rig(scenario) as rig:
        rig.move([0.0, 0.0, 0.2], 1.0)  # lower the hand over the object
        rig.advance(1.5, closure=1.0, force_limit=0.3)
        rig.move([0.0, 0.0, 0.4], 1.0)
        rig.advance(2.0, arm=shake([0.0, 0.0, 0.4], [0.0, 9.81, 0.0], 2.0, 2.0))
        held = rig.X_WO().translation()[2] > 0.1
        log = rig.log()
    largest_force = log["gripper.contact_force"].max()
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder, PortDataType

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.common.log_format import pose_key, pose_to_row
from drake_srg.common.systems import MakeSimulator, output_ports
from drake_srg.objects.config import ObjectConfig, SleepingConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.poses import ContactReader
from drake_srg.planning.planner_machine import PickAndPlace
from drake_srg.recording.video import VideoRecorder
from drake_srg.scenario import LocalizerConfig, Scenario, is_continuous, load_scenario
from drake_srg.scenario.schema import check_single_arm, robot_arms
from drake_srg.scenario.typed_yaml import load_typed, parse_yaml
from drake_srg.simulation import failure_time
from drake_srg.station import MakeStation
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.types import Vector


def shake(
    q: npt.ArrayLike, acceleration: npt.ArrayLike, frequency: float, duration: float
) -> Callable[[float], Vector]:
    """Return a shaking motion about an arm position, as a function of time [s].

    The amplitude swells and fades within two cycles each, so that the motion starts and
    ends at rest.

    Args:
        q: Middle position of the joints (N) [rad or m].
        acceleration: Acceleration of each joint at its turning points (N) [rad/s² or
            m/s²].
        frequency: Frequency of the sine [Hz].
        duration: Time from rest to rest [s].
    """
    omega = 2.0 * np.pi * frequency
    middle, amplitude = np.asarray(q, float), np.asarray(acceleration, float) / omega**2
    swell = 2.0 / frequency

    def position(t: float) -> Vector:
        envelope = minimum_jerk_blend(t / swell)
        envelope *= minimum_jerk_blend((duration - t) / swell)
        value: Vector = middle + envelope * np.sin(omega * t) * amplitude
        return value

    return position


def bench_scenario(
    thing: ObjectConfig | None = None,
    *,
    gripper_rpy: Sequence[float] | None = None,
    home: Sequence[float] | None = None,
    scenario: str | Path = "gripper_bench",
    overrides: Sequence[str] = (),
) -> Scenario:
    """Load a scenario of the gripper's bench with another object or hand pose.

    Args:
        thing: Object that replaces the scenario's own, as `objects.thing`. Without a
            position or pose, it takes the place of the scenario's object, under the
            hand.
        gripper_rpy: Roll, pitch and yaw [degrees] of the palm in the flange's frame,
            which is parallel to world on the gantry: [0, 90, 0] points down, [0, 0, 0]
            to the front.
        home: Joint positions of the arm at the start [rad or m].
        scenario: Name or path of the scenario.
        overrides: Entries `KEY=VALUE`, as for `load_scenario`.

    Raises:
        ScenarioError: If the scenario or an override is invalid.
    """
    bench = load_scenario(scenario, overrides=overrides)
    check_single_arm(bench, "a bench")
    if thing is not None:
        thing = copy.deepcopy(thing)
        if thing.position is None and thing.pose is None:
            thing.position = bench.objects[bench.task.pick].position
        bench.objects = {"thing": thing}
        bench.task.pick = "thing"
        bench.task.place.marker = ""  # the new object has no goal
    if gripper_rpy is not None:
        welds = [d.add_weld for d in bench.directives if d.add_weld is not None]
        (weld,) = [weld for weld in welds if weld.child == "gripper::palm"]
        weld.X_PC.rotation = Rotation(RollPitchYaw(np.deg2rad(gripper_rpy)))
    if home is not None:
        if bench.arm is None:
            raise ScenarioError(f"{scenario}: home: needs a scenario with an arm")
        bench.arm.home = [float(x) for x in home]
    bench.planner = PickAndPlace()  # the script was for the scenario's own object
    return bench


__all__ = ["Command", "Rig", "bench_scenario", "shake"]

# A command: a value, or a function of the time since the start of the call [s].
Command = npt.ArrayLike | Callable[[float], npt.ArrayLike]


class Rig:
    """A simulated station whose inputs the caller commands, with a log.

    At first, the arm is commanded to its home, and the gripper to open with its
    driver's force limit. With the same Drake, the same calls give the same log, bit
    for bit. With several arms, command each by its ports, with `fix`. The arguments of
    `advance` are only for a single arm.

    Args:
        scenario: The scenario to simulate. Its task, planner and script have no effect.
        name: Name of the experiment, for error messages.
        period: Time between samples of commands that are functions [s]; None: the arm
            driver's period, because the driver would miss samples in between.
        log_period: Time between rows of the log [s], a multiple of `period`.
        images: Whether to build the scenario's cameras, for `image`.
        video: An .mp4 file for the images of `recording.video_camera`. It is complete
            once the rig is closed, so use the rig in a `with` statement.

    Raises:
        ScenarioError: If the models do not fit the scenario.
        ValueError: If `log_period` is not a positive multiple of `period`.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        name: str = "rig",
        period: float | None = None,
        log_period: float = 0.01,
        images: bool = False,
        video: Path | str | None = None,
    ) -> None:
        if is_continuous(scenario):
            raise ScenarioError(f"{name}: needs plant_config.time_step above 0")
        self.scenario = scenario
        self._name = name
        robots = robot_arms(scenario)
        arm_periods = [robot.arm.period for robot in robots if robot.arm is not None]
        self._period = period or min(arm_periods, default=0.005)
        self._rows_every = round(log_period / self._period)
        off = abs(self._rows_every * self._period - log_period)
        if self._rows_every < 1 or off > 1e-9:
            raise ValueError(
                "log_period must be a positive multiple of period, "
                f"{self._period} s, got {log_period} s"
            )
        self._video: VideoRecorder | None = None
        if video is None and not images:  # building unused cameras takes time
            scenario = dc.replace(scenario, cameras={}, localizer=LocalizerConfig())
        with scenario_errors(name), contextlib.ExitStack() as stack:
            builder = DiagramBuilder()
            self.station = builder.AddNamedSystem("station", MakeStation(scenario))
            for i in range(self.station.num_input_ports()):
                port = self.station.get_input_port(i)
                builder.ExportInput(port, port.get_name())
            if video is not None:
                self._video = stack.enter_context(_add_video(builder, self, video))
            self.diagram = builder.Build()
            self.diagram.set_name(name)
            self.simulator = MakeSimulator(self.diagram, scenario.simulator_config)
            self.context = self.simulator.get_mutable_context()
            self._advance = MakeAdvance(self.simulator, self.station, scenario)
            stack.pop_all()
        self.plant = self.station.GetSubsystemByName("plant")
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self._station_context = self.station.GetMyContextFromRoot(self.context)
        self._ports = output_ports(self.station)
        self._commanded: dict[str, Vector] = {}
        for robot in robots:
            if robot.arm is not None:
                self.fix(f"{robot.arm_model}.position_commanded", robot.arm.home)
            if robot.gripper is not None:
                self.fix(f"{robot.gripper_model}.closure_commanded", 0.0)
        self._robots = [*(robot.arm_model for robot in robots)]
        self._robots += [robot.gripper_model for robot in robots]
        self._readers: dict[str, ContactReader] = {}
        self._tick = 0
        self._rows: list[dict[str, Vector | float]] = []

    # Simulation.

    def advance(
        self,
        duration: float,
        *,
        arm: Command | None = None,
        closure: Command | None = None,
        force_limit: Command | None = None,
    ) -> None:
        """Simulate for some time. Commands that are None stay as they are.

        Args:
            duration: Time to simulate, rounded to whole periods [s].
            arm: Joint positions (N) [rad or m].
            closure: 0 (open) .. 1 (closed).
            force_limit: Fraction of full PWM, 0 .. 1.

        Raises:
            ScenarioError: If Drake aborts the simulation; the message has the time.
        """
        given = {
            "arm.position_commanded": arm,
            "gripper.closure_commanded": closure,
            "gripper.force_limit": force_limit,
        }
        functions: dict[str, Callable[[float], npt.ArrayLike]] = {}
        for name, value in given.items():
            if callable(value):
                functions[name] = value
            elif value is not None:
                self.fix(name, value)
        for i in range(round(duration / self._period)):
            for name, function in functions.items():
                self.fix(name, function(i * self._period))
            with failure_time(self._name, self.simulator):
                if self._tick == 0:
                    self.simulator.Initialize()
                    self._log_row()
                self._tick += 1
                self._advance(self._tick * self._period)
            if self._tick % self._rows_every == 0:
                self._log_row()

    def move(self, q: npt.ArrayLike, duration: float) -> None:
        """Move the arm with minimum jerk from its last command to `q` (N) [rad or m].

        On the gantry, `q` is the hand's position relative to the middle of the bench.

        Raises:
            ScenarioError: If Drake aborts the simulation; the message has the time.
        """
        start, end = self.commanded("arm.position_commanded"), np.asarray(q, float)
        self.advance(
            duration,
            arm=lambda t: start + minimum_jerk_blend(t / duration) * (end - start),
        )
        self.fix("arm.position_commanded", end)

    def fix(self, name: str, value: npt.ArrayLike) -> None:
        """Set an input port of the station until further notice.

        Raises:
            ScenarioError: If there is no such port or the value has the wrong size.
        """
        vector = np.atleast_1d(np.asarray(value, dtype=float))
        if not self.diagram.HasInputPort(name):
            raise ScenarioError(f"{self._name}: the station has no input {name}")
        port = self.diagram.GetInputPort(name)
        if vector.shape != (port.size(),):
            raise ScenarioError(
                f"{self._name}: {name} needs {port.size()} numbers, got {vector.size}"
            )
        port.FixValue(self.context, vector)
        self._commanded[name] = vector

    # Results.

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.context.get_time())

    def commanded(self, name: str) -> Vector:
        """Return the last value set on an input port of the station."""
        return self._commanded[name].copy()

    def measured(self, name: str) -> Vector:
        """Return the present value of a vector output port of the station."""
        return np.array(self._ports[name].Eval(self._station_context))

    def image(self, camera: str) -> npt.NDArray[np.uint8]:
        """Return a camera's present image, RGB (height, width, 3); needs `images`."""
        port = self._ports[f"camera_{camera}.color_image"]
        return np.array(port.Eval(self._station_context).data[:, :, :3])

    def X_WO(self, name: str | None = None) -> RigidTransform:
        """Return the pose of an object in world; by default, of the picked one."""
        poses = self._ports["object_poses_cheat"].Eval(self._station_context)
        X_WO: RigidTransform = poses[name or self.scenario.task.pick]
        return X_WO

    def X_WG(self, gripper_model: str = "gripper") -> RigidTransform:
        """Return the pose of the palm frame of a gripper in world."""
        gripper = self.plant.GetModelInstanceByName(gripper_model)
        palm = self.plant.GetFrameByName("palm", gripper)
        return palm.CalcPoseInWorld(self.plant_context)

    def X_GO(self) -> RigidTransform:
        """Return the pose of the picked object in the palm."""
        return self.X_WG().inverse() @ self.X_WO()

    def contact_forces(self, name: str | None = None) -> dict[str, float]:
        """Return the contact forces on an object; see `ContactReader.forces`."""
        name = name or self.scenario.task.pick
        if name not in self._readers:
            self._readers[name] = ContactReader(self.plant, name, self._robots)
        results = self._ports["contact_results_cheat"].Eval(self._station_context)
        return self._readers[name].forces(results)

    def log(self) -> dict[str, Vector]:
        """Return the log, with one row (K) every `log_period`.

        Its arrays are `time` (K) [s], all vector outputs of the station by name (K, n),
        the inputs that were set (K, n), and `object_pose.NAME` (K, 7) [x, y, z, qw, qx,
        qy, qz]. Inputs are the values that led to the row, or NaN before an input was
        first set.
        """
        last = self._rows[-1] if self._rows else {}
        return {
            name: np.array(
                [row.get(name, np.full_like(x, np.nan)) for row in self._rows]
            )
            for name, x in last.items()
        }

    def _log_row(self) -> None:
        row: dict[str, Vector | float] = {"time": self.time, **self._commanded}
        for name, port in self._ports.items():
            if port.get_data_type() == PortDataType.kVectorValued:
                row[name] = self.measured(name)
        poses = self._ports["object_poses_cheat"].Eval(self._station_context)
        for name, X_WO in poses.items():
            row[pose_key(name)] = pose_to_row(X_WO)
        self._rows.append(row)

    def __enter__(self) -> Rig:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._video is not None:
            self._video.__exit__(kind, error, traceback)


def _add_video(builder: DiagramBuilder, rig: Rig, path: Path | str) -> VideoRecorder:
    name = rig.scenario.recording.video_camera
    if not name:
        raise ScenarioError("recording.video_camera: must name a camera for the video")
    camera = rig.scenario.cameras[name]
    recorder = VideoRecorder(
        path,
        camera.width,
        camera.height,
        frame_rate=rig.scenario.recording.video_fps,
    )
    builder.AddNamedSystem("video_recorder", recorder)
    image = rig.station.GetOutputPort(f"camera_{name}.color_image")
    builder.Connect(image, recorder.GetInputPort("color_image"))
    return recorder


# The contact settings of experiments/resting.py, with Drake's default stiction
# tolerance.
TABLETOP = """
plant_config:
  time_step: 0.005
  contact_model: hydroelastic_with_fallback
  discrete_contact_approximation: lagged
directives:
- add_model: {name: table, file: package://drake_srg/sdf/table_mat.sdf}
table: {min: [-0.4, -0.8], max: [1.3, 0.8]}
"""


def tabletop(
    objects: Mapping[str, ObjectConfig], sleeping: SleepingConfig | None = None
) -> Scenario:
    """Return a scenario with objects on a table, and without a robot."""
    tree = parse_yaml(TABLETOP, "tabletop")
    scenario: Scenario = load_typed(Scenario, tree, "tabletop")
    scenario.objects = dict(objects)
    scenario.sleeping = sleeping
    return scenario


HEIGHT = 0.005  # of a dropped object's underside above the table [m]
_PLACE = (0.5, 0.0)  # of the drop, x, y in world [m]
QUIET = 0.005  # an object rests below this speed [m/s]
# Earliest and latest end of a drop, and the time for which the object must rest [s].
SOON, LATE, _WATCHED = 1.2, 3.0, 0.2
_PERIOD = 0.01  # between samples of the speed [s]


@dc.dataclass(frozen=True)
class DropOutcome:
    """Motion of a dropped object.

    Attributes:
        rests: Whether it rests on the table.
        after: Time since its release [s].
        speed: Largest speed of any of its points in the last 0.2 s [m/s].
        moved: Horizontal distance of its origin from the place of its release [m].
    """

    rests: bool
    after: float
    speed: float
    moved: float

    def __str__(self) -> str:
        """Return the outcome in words."""
        verb = "rests" if self.rests else "does not rest"
        return (
            f"{verb}: {1e3 * self.speed:.1f} mm/s {self.after:g} s after a drop from "
            f"{1e3 * HEIGHT:g} mm, {1e3 * self.moved:.1f} mm to the side"
        )


def above_table(thing: ObjectConfig) -> Scenario:
    """Return a scenario in which an object is released 5 mm above a table.

    Args:
        thing: The object, which becomes `objects.thing`, in its standing orientation.

    Raises:
        ScenarioError: If the object's model cannot be read.
    """
    low = object_facts("thing", thing).low
    X_WO = RigidTransform([*_PLACE, HEIGHT - low[2]])
    return tabletop({"thing": dc.replace(thing, pose=Transform(X_WO), position=None)})


def drop(thing: ObjectConfig) -> DropOutcome:
    """Drop an object, and simulate until it rests, for at most 3 s.

    Args:
        thing: The object; it falls in its standing orientation.

    Raises:
        ScenarioError: If the object's model cannot be read.
    """
    prepared = above_table(thing)
    size = np.linalg.norm(object_facts("thing", thing).size)
    with Rig(prepared, name="drop", period=_PERIOD, log_period=_PERIOD) as rig:
        model = rig.plant.GetModelInstanceByName("thing")
        (index,) = rig.plant.GetBodyIndices(model)
        body = rig.plant.get_body(index)
        start = rig.X_WO("thing").translation()
        speeds: list[float] = []
        try:
            while True:
                rig.advance(_PERIOD)
                V = rig.plant.EvalBodySpatialVelocityInWorld(rig.plant_context, body)
                turning = 0.5 * size * np.linalg.norm(V.rotational())
                speeds.append(float(max(np.linalg.norm(V.translational()), turning)))
                recent = speeds[-round(_WATCHED / _PERIOD) :]
                quiet = max(recent) < QUIET
                if rig.time > LATE - 1e-6 or (rig.time > SOON - 1e-6 and quiet):
                    break
        except ScenarioError:  # Drake gave up on the contact
            return DropOutcome(False, rig.time, np.inf, np.inf)
        away = rig.X_WO("thing").translation() - start
    moved = float(np.linalg.norm(away[:2]))
    on_table = abs(away[2]) < size
    return DropOutcome(bool(quiet and on_table), round(rig.time, 2), max(recent), moved)
