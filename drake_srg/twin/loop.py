"""Advances a twin along with its robot."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Diagram

from drake_srg.common.actuators import model_actuators
from drake_srg.common.simulator import MakeSimulator
from drake_srg.lifetime import my_context
from drake_srg.scenario import Scenario
from drake_srg.simulation import failure_time
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.twin.listener import Told
from drake_srg.twin.monitor import KINDS
from drake_srg.twin.placing import Placing
from drake_srg.twin.sightings import Sighting
from drake_srg.twin.station import twin_period
from drake_srg.types import Vector

_ROUNDING = 1e-6  # of stamps, which are whole nanoseconds [s]


@dc.dataclass(frozen=True)
class Parting:
    """A difference between a robot and its twin that has lasted.

    Attributes:
        time: Of the report [s].
        kind: One of `KINDS`.
        difference: The largest, in the unit of the limit.
        limit: That it exceeds.
        text: A sentence for the user.
    """

    time: float
    kind: str
    difference: float
    limit: float
    text: str


class TwinLoop:
    """Advances a twin to the times at which its robot has told something.

    The twin's clock is the robot's, from 0 on: nothing depends on this machine's speed.
    Between two messages, the robot is taken to move evenly. Only `follow` touches the
    context, so all of it happens in one thread.

    Args:
        name: The scenario's, for messages.
        scenario: Of the twin.
        root: The root diagram, with the twin in it.
        twin: Of `MakeTwin`.
        first: What the robot told first; the arm starts there.

    Attributes:
        context: The root's.
        partings: All reports so far.
        largest: Largest difference of each of `KINDS` so far, shape (4,).
        skipped: Time between messages that were too far apart [s].
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        root: Diagram,
        twin: Diagram,
        first: Told,
    ) -> None:
        assert scenario.arm is not None
        self._name, self._twin, self._config = name, twin, scenario.twin
        self._period, self._start = twin_period(scenario), first.stamp
        self._simulator = MakeSimulator(root, scenario.simulator_config)
        self._simulator.set_target_realtime_rate(0.0)
        self.context = self._simulator.get_mutable_context()
        self._own = my_context(twin, self.context)
        plant = twin.GetSubsystemByName("station").GetSubsystemByName("plant")
        plant_context = plant.GetMyMutableContextFromRoot(self.context)
        self._n = len(first.arm_torque)
        arm = plant.GetModelInstanceByName("arm")
        self._efforts = [a.effort_limit() for a in model_actuators(plant, arm)]
        plant.SetPositions(plant_context, arm, first.arm_state[: self._n])
        self._names = [n for n, config in scenario.objects.items() if config.present]
        self._placing = Placing(plant, plant_context, self._names)
        self._seen: dict[str, Sighting] = {}
        self._told, self._steps = first, 0
        self._quiet_until = self._config.settle
        self._parted = np.zeros(len(KINDS), dtype=bool)
        self.partings: list[Parting] = []
        self.largest, self.skipped = np.zeros(len(KINDS)), 0.0
        self._fix(first.arm_state, first)
        with failure_time(name, self._simulator):
            self._simulator.Initialize()
        self._advance = MakeAdvance(self._simulator, twin, scenario)

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self.context.get_time())

    def value(self, port: str) -> Any:
        """Return the present value of an output port of the twin."""
        return self._twin.GetOutputPort(port).Eval(self._own)

    def follow(self, told: Told) -> list[Parting]:
        """Advance to the time of what the robot told; return the new reports.

        Raises:
            ScenarioError: If Drake fails.
        """
        last, begin = self._told, self._time_of(self._told.stamp)
        end = self._time_of(told.stamp)
        gap = end - begin
        if gap > self._config.silence:  # its clock has been set, or it was away
            self.skipped += gap - self._period
            end = begin + self._period
        if gap > self._config.patience:
            self._quiet_until = end + self._config.settle
        self._told = told
        shift = self._start + self.skipped
        for seen in told.sightings:
            self._seen[seen.name] = dc.replace(seen, time=seen.time - shift)
        new: list[Parting] = []
        self._place(told)
        while (self._steps + 1) * self._period <= end + _ROUNDING:
            share = (self.time - begin) / max(end - begin, self._period)
            share = min(max(share, 0.0), 1.0)
            state = (1.0 - share) * last.arm_state + share * told.arm_state
            self._fix(state, told)
            self._steps += 1
            with failure_time(self._name, self._simulator):
                self._advance(self._steps * self._period)
            new += self._reports()
        return new

    def _time_of(self, stamp: float) -> float:
        return stamp - self._start - self.skipped

    def _place(self, told: Told) -> None:
        """Put objects where they are seen, if that is needed."""
        where = dict(zip(self._names, self.value("twin.object_error"), strict=True))
        parted = {
            name: bool(self._parted[KINDS.index("object")])
            and error > self._config.object
            for name, error in where.items()
        }
        self._placing.place(told.sightings, parted, self.time)

    def _fix(self, arm_state: Vector, told: Told) -> None:
        values: dict[str, Any] = {
            "gripper.closure_commanded": [told.closure or 0.0],
            "robot.arm_state": arm_state,
            "robot.arm_torque": told.arm_torque,
            "robot.arm_torque_or_zero": np.nan_to_num(told.arm_torque),
            "robot.gripper_state": told.gripper_state,
            "robot.sightings": AbstractValue.Make(tuple(self._seen.values())),
            "robot.placed_at": AbstractValue.Make(dict(self._placing.placed_at)),
        }
        for name, value in values.items():
            self._twin.GetInputPort(name).FixValue(self._own, value)

    def _reports(self) -> list[Parting]:
        """Return a report for each kind of difference that has begun."""
        difference = self.value("twin.difference")
        self.largest = np.maximum(self.largest, difference)
        parted = self.value("twin.parted") > 0.5
        if self.time < self._quiet_until:
            return []
        begun, self._parted = parted & ~self._parted, parted
        new = []
        for kind, amount in zip(
            np.array(KINDS)[begun], difference[begun].tolist(), strict=True
        ):
            limit = float(getattr(self._config, kind))
            text = f"t = {self.time:.2f} s: {self._sentence(kind, amount, limit)}"
            new.append(Parting(self.time, str(kind), amount, limit, text))
        self.partings += new
        return new

    def _sentence(self, kind: str, amount: float, limit: float) -> str:
        def worst(port: str) -> int:
            return int(np.argmax(np.abs(np.nan_to_num(self.value(port)))))

        if kind == "joint":
            i = worst("twin.joint_error") + 1
            return f"joint {i} is {amount:.3f} rad from the twin's (limit {limit:g})"
        if kind == "torque":
            residual = np.nan_to_num(self.value("twin.torque_residual"))
            i = int(np.argmax(np.abs(residual) / self._efforts))
            return (
                f"joint {i + 1} has {amount * self._efforts[i]:.1f} N m more or less "
                f"than the twin expects, {amount:.1%} of its largest torque "
                f"(limit {limit:.1%})"
            )
        if kind == "finger":
            i = worst("twin.finger_error")
            more = "more" if self.value("twin.finger_error")[i] > 0.0 else "less"
            return (
                f"finger joint {i + 1} is {amount:.3f} rad {more} closed than the "
                f"twin's (limit {limit:g})"
            )
        name = self._names[worst("twin.object_error")]
        return f"{name} is seen {amount:.3f} m from the twin's (limit {limit:g})"
