"""An episode of a task: its simulation and ground truth."""

from __future__ import annotations

import collections
import dataclasses as dc
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.log_format import pose_key, pose_to_row, row_to_pose
from drake_srg.common.systems import MakeSimulator
from drake_srg.learning.evaluate_in_cell import CellPolicy, make_planner
from drake_srg.learning.rules import pick_by_touch
from drake_srg.lifetime import free_diagrams, my_context
from drake_srg.objects.household import object_facts
from drake_srg.objects.poses import ContactReader
from drake_srg.scenario import Scenario, perception_cameras, robot_arms, servo_of
from drake_srg.simulation.clearing import resting_places
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.metrics import is_placed
from drake_srg.station import AddStation, MakeStation
from drake_srg.station.cell import command_ports
from drake_srg.station.perception import destinations
from drake_srg.station.planners import final_pose
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.suite.cell import AddDrivenCell, MakeDrivenCell
from drake_srg.types import PlannerStatus, Vector

PERIOD = 1 / 16  # between actions [s]
# The goal must be reached in this many samples in a row: half a second.
HELD = 8
_ROUNDING = 1e-9
# Gain of `pick_by_touch`: the share of an error that it corrects per control period. In
# the rule's environment, the hand lags by up to 2 periods. Here, it lags by 4/3 more,
# because actions last 1/16 s. With a lag of d periods, gains below
# 2 sin(pi / (4 d + 2)) are stable (Levin and May, Theoretical Population Biology 9:178,
# 1976). The rule's default gain, 0.4, is 0.65 of this limit, and so is this one.
_TOUCH_GAIN = 0.263
LIFTED = 0.05  # a lifted object is at least this much higher than at the start [m]
_FELL = 0.2  # an object this far below the table has fallen off it [m]


class EpisodeError(Exception):
    """Drake could not advance an episode; the message is one line."""


def reading_times(tick: int, periods: Iterable[float]) -> Vector:
    """Return the times within an action period at which drivers read commands [s].

    The command must move between any two readings, because drivers derive speeds from
    it.

    Args:
        tick: Number of the action period.
        periods: Periods of the drivers [s].
    """
    times = []
    for period in periods:
        start, end = (
            math.ceil((tick + more) * PERIOD / period - _ROUNDING) for more in (0, 1)
        )
        times.append(period * np.arange(start, end, dtype=float))
    return np.unique(np.concatenate(times))


class Episode:
    """One episode of a task.

    A command (K) has, for each arm in the scenario's order, the positions of its joints
    [rad] and then its hand's closure, 0 open .. 1 closed.

    Attributes:
        scenario: The scenario.
        command: The present command (K): at first, arms at home with open hands.
        closures: Indices of the closures in a command, one for each arm.

    Args:
        task_goal: `lift`, `place` or `clear`; see `Task`.
        scenario: The scenario, drawn, with the cameras that are needed.
        name: Name of the task, for error messages.
        expert: `Task.expert`, to propose actions; None: no expert.

    Raises:
        ScenarioError: If the models do not fit the scenario.
        EpisodeError: If Drake cannot begin to simulate it.
    """

    def __init__(
        self, task_goal: str, scenario: Scenario, name: str, expert: str | None
    ) -> None:
        free_diagrams()  # those of the previous episode
        self.scenario, self._goal = scenario, task_goal
        make: Callable[..., Diagram] = MakeStation
        add: Callable[..., None] = _AddStationAlone
        if expert is not None:
            planner = _touching if expert == "touch" else None
            make = functools.partial(MakeDrivenCell, make_planner=planner)
            add = functools.partial(AddDrivenCell, make_planner=planner)
        builder, self._cell = MakeRoot(
            "station" if expert is None else "cell", make, add, scenario, name
        )
        diagram = builder.Build()
        self._simulator = MakeSimulator(diagram, scenario.simulator_config)
        self._root = self._simulator.get_mutable_context()
        self._context = my_context(self._cell, self._root)
        self._arms = robot_arms(scenario)
        drivers = [arm.arm for arm in self._arms if arm.arm is not None]
        homes = [np.array(driver.home) for driver in drivers]
        self._hands = [arm.gripper_model for arm in self._arms]
        self._periods = {driver.period for driver in drivers}
        self.command = np.concatenate([np.append(home, 0.0) for home in homes])
        self.closures = np.cumsum([len(home) + 1 for home in homes]) - 1
        self._set_positions = [
            self._fix(f"{arm.arm_model}.position_commanded", home)
            for arm, home in zip(self._arms, homes, strict=True)
        ]
        self._set_closures = [
            self._fix(f"{arm.gripper_model}.closure_commanded", np.zeros(1))
            for arm in self._arms
        ]
        self._advance = MakeAdvance(self._simulator, self._cell, scenario)
        self._ticks = 0
        self._reader: ContactReader | None = None
        self._times: collections.deque[float] = collections.deque(maxlen=HELD)
        self._poses: collections.deque[dict[str, Vector]] = collections.deque(
            maxlen=HELD
        )
        self._touching: set[str] = set()
        try:
            self._simulator.Initialize()
        except (RuntimeError, SystemExit) as error:
            raise EpisodeError(one_line(error)) from error
        self._facts = (
            {
                name: object_facts(name, scenario.objects[name])
                for name in destinations(scenario)
                if scenario.objects[name].present
            }
            if task_goal == "clear"
            else {}
        )
        self._sample()
        self._start = self._poses[-1]

    def _fix(self, name: str, value: Vector) -> Callable[[Vector], None]:
        """Fix an input port, and return a function that sets it."""
        fixed = self._cell.GetInputPort(name).FixValue(self._context, value)

        def set_value(new: Vector) -> None:
            fixed.GetMutableData().get_mutable_value().SetFromVector(new)

        return set_value

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._ticks * PERIOD

    def measured(self, name: str) -> Any:
        """Return the present value of an output port."""
        return self._cell.GetOutputPort(name).Eval(self._context)

    def image(self, camera: str) -> npt.NDArray[np.uint8]:
        """Return a camera's present image, RGB (height, width, 3)."""
        image = self.measured(f"camera_{camera}.color_image")
        return np.array(image.data[:, :, :3])

    def advance(self, command: Vector) -> None:
        """Simulate one period, in which the joints' command moves evenly to `command`.

        The closures of `command` (K) take effect at once.

        Raises:
            EpisodeError: If Drake gives up, or the state is no longer finite.
        """
        before, self.command = self.command, command
        for set_closure, index in zip(self._set_closures, self.closures, strict=True):
            set_closure(command[[index]])
        try:
            for time in reading_times(self._ticks, self._periods):
                if time > self.time:
                    self._advance(time)
                share = (time - self.time) / PERIOD
                moved = before + share * (command - before)
                parts = np.split(moved, self.closures[:-1] + 1)
                for set_position, part in zip(self._set_positions, parts, strict=True):
                    set_position(part[:-1])
            self._ticks += 1
            self._advance(self._ticks * PERIOD)
            self._sample()
        except (RuntimeError, SystemExit, ScenarioError) as error:
            raise EpisodeError(one_line(error)) from error
        if not all(np.isfinite(row).all() for row in self._poses[-1].values()):
            raise EpisodeError("an object's pose is no longer finite")

    def _sample(self) -> None:
        poses = self.measured("object_poses_cheat")
        self._times.append(self.time)
        self._poses.append({n: pose_to_row(X_WO) for n, X_WO in poses.items()})
        if self._goal == "clear":
            return
        contacts = self.measured("contact_results_cheat")
        if self._reader is None:
            arms = [arm.arm_model for arm in self._arms]
            robots = (*arms, *self._hands)
            pick = self.scenario.task.pick
            self._reader = ContactReader(contacts.plant(), pick, robots)
        self._touching = set(self._reader.forces(contacts))

    # Ground truth.

    def succeeds(self) -> bool:
        """Return whether the goal has been reached.

        For `lift`, the object must be up for half a second. For `place` and `clear`,
        objects must rest at the end of this time.
        """
        if len(self._times) < HELD:
            return False
        if self._goal == "clear":
            return self._cleared()
        pick = self.scenario.task.pick
        poses = np.array([sample[pick] for sample in self._poses])
        start = self._start[pick]
        if self._goal == "lift":
            return bool(
                np.all(poses[:, 2] > start[2] + LIFTED)
                and self._touching.intersection(self._hands)
            )
        time = np.array(self._times)
        return is_placed(self.scenario, row_to_pose(start), time, poses, self._touching)

    def _cleared(self) -> bool:
        wanted = destinations(self.scenario)
        log = {"time": np.array(self._times)} | {
            pose_key(name): np.array([sample[name] for sample in self._poses])
            for name in self._facts
        }
        found = resting_places(self.scenario, log, self._facts)
        # An object without a bin must not be in one.
        return all(found[name] == wanted[name] for name in self._facts)

    def lost(self) -> bool:
        """Return whether an object has fallen off the table or is 3 m away."""
        floor = self.scenario.table.height - _FELL
        return any(
            row[2] < floor or math.hypot(*row[:2]) > 3.0
            for row in self._poses[-1].values()
        )

    def picked(self) -> tuple[list[RigidTransform], Vector]:
        """Return the picked object's pose X_PO in each palm, and the way to its goal.

        The latter is the vector p_OG_W from the object to its goal, shape (3,) [m].
        """
        pick = self.scenario.task.pick
        X_WO = row_to_pose(self._poses[-1][pick])
        X_WG = final_pose(self.scenario, row_to_pose(self._start[pick]))
        plant = self.measured("contact_results_cheat").plant()
        context = plant.GetMyContextFromRoot(self._root)
        palms = [
            plant.GetFrameByName("palm", plant.GetModelInstanceByName(hand))
            for hand in self._hands
        ]
        X_POs = [palm.CalcPoseInWorld(context).InvertAndCompose(X_WO) for palm in palms]
        return X_POs, X_WG.translation() - X_WO.translation()

    # The expert.

    def proposal(self) -> Vector:
        """Return the command (K) that the expert proposes.

        Its positions are those that the present plan has at the end of the next period.
        """
        now = self._root.get_time()
        self._root.SetTime(now + PERIOD)
        try:
            ports = [f"planner.{name}" for name, _ in command_ports(self._arms)]
            return np.concatenate([self.measured(port) for port in ports])
        finally:
            self._root.SetTime(now)

    @property
    def status(self) -> PlannerStatus:
        """The expert's own status report."""
        status: PlannerStatus = self.measured("planner.status")
        return status


def _AddStationAlone(
    builder: DiagramBuilder, scenario: Scenario, make_station: object = None
) -> None:
    del make_station  # only cells need it
    AddStation(builder, scenario)


def _touching(scenario: Scenario) -> System:
    act = functools.partial(pick_by_touch, gain=_TOUCH_GAIN)
    policy = CellPolicy(act, "drake_srg/Pick-v0")
    return make_planner(policy, scenario)


def with_cameras(scenario: Scenario, cameras: Sequence[str]) -> Scenario:
    """Return a scenario with only these cameras and those that the planner uses."""
    needed = {*cameras, *perception_cameras(scenario)}
    if (servo := servo_of(scenario)) is not None:
        needed.add(servo.camera)
    kept = {name: c for name, c in scenario.cameras.items() if name in needed}
    return dc.replace(scenario, cameras=kept)
