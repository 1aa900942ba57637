"""A system that stands in for a planner in another process, and never waits."""

from __future__ import annotations

import abc
import dataclasses as dc
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, State
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.lifetime import LeafSystem, weak
from drake_srg.planning.motion.arm_motion import STOP_TIME, Motion
from drake_srg.planning.planner_machine import AddCommandOutputs, AddStatusOutput
from drake_srg.planning.servoing.config import ServoCommand, ServoStatus
from drake_srg.planning.servoing.tracker import Sighting
from drake_srg.robot.serve.commands import PortValues, port_of
from drake_srg.scenario import RobotArm
from drake_srg.types import Failure, Mode, PlannerStatus, Vector


@dc.dataclass(frozen=True)
class Tick:
    """Inputs of the planner; its clock advances by one period per tick.

    Attributes:
        values: Measurements, and the robot's clock, by output port of the station.
    """

    values: PortValues
    servo: ServoStatus | None = None


@dc.dataclass(frozen=True)
class Answer:
    """The planner's commands to an arm, and its reports, after a tick.

    Attributes:
        time: The planner's clock [s]; `motion` refers to it.
        motion: The arm's motion; None: the previous one continues.
        closure: The gripper's closure, 0 open .. 1 closed.
        status: The report on the task.
        command: The command to the visual servo, if there is one.
        sighting: What a new picture of the servo's camera shows; None: no new picture.
        planning_wall: Time spent planning so far, on the wall clock [s].
        arm: The arm's name; empty: a single arm.
        joints: Which joints of the motion are the arm's.
    """

    time: float
    motion: Motion | None
    closure: float
    status: PlannerStatus
    command: ServoCommand = ServoCommand.PASS
    sighting: Sighting | None = None
    planning_wall: float = 0.0
    arm: str = ""
    joints: slice = dc.field(default_factory=lambda: slice(None))


@dc.dataclass(frozen=True)
class Ended:
    """The planner's process has ended, and there will be no more answers."""

    reason: str


class PlannerLink(abc.ABC):
    """Connects the control loop with a planner. Both methods return at once."""

    @abc.abstractmethod
    def post(self, tick: Tick) -> None:
        """Send a tick, or drop it while the planner is busy with earlier ones."""

    @abc.abstractmethod
    def take(self) -> Sequence[Answer | Ended]:
        """Return what has arrived since the last call, in order."""


# After a stop for one of these reasons, the monitor continues along the path of the
# commands. After others, it waits for commands that begin where the arm rests.
_PATH_KEPT = {
    StopReason.FOLLOWING_ERROR,
    StopReason.MEASURED_SPEED,
    StopReason.MEASURED_NOT_FINITE,
    StopReason.EXTERNAL_TORQUE,
    StopReason.FORCE,
    StopReason.STALE,
}
# An arm that rests off its path returns there in at least this time [s], and at most
# this fast [rad/s or m/s].
_RETURN_TIME, _RETURN_SPEED = 0.5, 0.2
_THERE = 1e-6  # rad or m


@dc.dataclass(frozen=True)
class Pause:
    """A motion while the arm is stopped, and until it is back on its path.

    Attributes:
        stopped: The motion that the stop interrupted, braked to rest within the
            planner's limits.
        motion: The commands during the pause.
        held: Where the arm rests, shape (N,) [rad or m]; None: it still moves.
        cut: Whether the monitor has forgotten the path.
        until: When the next step after the release is due [s]; infinite before.
        since: Time on the path of `stopped` at which it continues [s]; None until the
            arm returns there.
    """

    stopped: Motion
    motion: Motion
    held: Vector | None = None
    cut: bool = False
    until: float = math.inf
    since: float | None = None

    @classmethod
    def begun(cls, motion: Motion, time: float) -> Pause:
        """Return the pause that begins with a stop."""
        stopped = motion.stopped(time)
        return cls(stopped, stopped)

    def go_on(
        self, time: float, state: SafetyState, reason: StopReason, held: Vector
    ) -> Pause | Motion:
        """Return the pause one control period later, or the motion that ends it.

        Args:
            time: Now [s].
            state: State of the safety monitor.
            reason: Reason of the stop.
            held: Where the arm rests in a stop, shape (N,) [rad or m]; otherwise NaN.
        """
        if state is not SafetyState.RUNNING:
            return dc.replace(
                self,
                motion=self.motion.stopped(time),
                held=held.copy() if np.isfinite(held).all() else self.held,
                cut=reason not in _PATH_KEPT,
                until=math.inf,
                since=None,
            )
        if math.isinf(self.until) and not self.cut:  # the monitor keeps to its path
            return dc.replace(self, until=time + STOP_TIME)
        if math.isfinite(self.until) and time < self.until:
            return self
        if self.since is not None:
            return self.stopped.resumed(time, self.since)
        # Where the arm rests now.
        start = self.motion.destination
        if self.cut and self.held is not None:
            start = self.held
        since, q = self.stopped.nearest(start)
        if np.max(np.abs(q - start)) < _THERE:
            return self.stopped.resumed(time, since)
        back = _line(start, q)
        motion = Motion(start).followed_by(back, time)
        return dc.replace(self, motion=motion, since=since, until=motion.due)


def _line(start: Vector, goal: Vector) -> PiecewisePolynomial:
    """Return a straight motion in joint space, from rest to rest."""
    duration = max(_RETURN_TIME, float(np.max(np.abs(goal - start))) / _RETURN_SPEED)
    rest = np.zeros(len(start))
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        [0.0, duration], np.stack([start, goal], axis=1), rest, rest
    )


# Without an answer for this long, a servo must hold [s]. The planner answers every
# period unless it plans, which it does only while the hand rests.
_SERVO_PATIENCE = 0.5


@dc.dataclass(frozen=True)
class Plan:
    """The planner's most recent answer for an arm.

    Attributes:
        motion: The arm's motion, by the planner's clock.
        behind: How far the planner's clock lags behind ours in `motion` [s].
        closure: The gripper's closure, 0 open .. 1 closed.
        status: The report on the task.
        command: The command to the visual servo, if there is one.
        sighting: The servo's newest sighting while it tracks, if there is one.
        answered: When the last answer arrived, by our clock [s].
        pause: The pause while the arm is stopped, and until it is back on its path. It
            replaces `motion`, and is by our clock.
        departed: When the planner's motion began, by the planner's clock [s], if
            `motion` is the rest of it after a pause; otherwise None.
        joints: Which joints of the motion are the arm's.
    """

    motion: Motion
    behind: float = 0.0
    closure: float = 0.0
    status: PlannerStatus = dc.field(default_factory=PlannerStatus)
    command: ServoCommand = ServoCommand.PASS
    sighting: Sighting | None = None
    answered: float = 0.0
    pause: Pause | None = None
    departed: float | None = None
    joints: slice = dc.field(default_factory=lambda: slice(None))

    def position(self, time: float) -> Vector:
        """Return the arm's commanded position at a time [s], shape (N,) [rad or m]."""
        if self.pause is not None:
            return self.pause.motion.position(time)[self.joints]
        return self.motion.position(time - self.behind)[self.joints]

    def after(self, answer: Answer, time: float) -> Plan:
        """Return the plan that follows from an answer at a time [s]."""
        tracks = answer.command is ServoCommand.TRACK
        plan = dc.replace(
            self,
            closure=answer.closure,
            status=answer.status,
            command=answer.command,
            sighting=answer.sighting or (self.sighting if tracks else None),
            answered=time,
            joints=answer.joints,
        )
        motion = answer.motion
        if motion is None:
            return plan
        if self._goes_on(motion):
            # The planner stops this motion. The arm may be farther along than the
            # planner knew, and must not jump back.
            assert motion.stopped_at is not None
            if self.departed is not None:  # `motion` continues after a pause
                return dc.replace(plan, motion=self.motion.stopped(time - self.behind))
            reached = time - self.behind - motion.departed
            stop = max(motion.stopped_at, reached)
            return dc.replace(plan, motion=dc.replace(motion, stopped_at=stop))
        behind = time - answer.time
        return dc.replace(plan, motion=motion, behind=behind, departed=None)

    def held_up(
        self, time: float, state: SafetyState, reason: StopReason, held: Vector
    ) -> Plan:
        """Return the plan after a control period in which the arm may be stopped.

        Args:
            time: Now [s].
            state: State of the safety monitor.
            reason: Reason of the stop, if there is one.
            held: Where the arm rests in a stop, shape (N,) [rad or m]; otherwise NaN.
        """
        if self.pause is None:
            if state is SafetyState.RUNNING:
                return self
            motion = self.motion
            ours = dc.replace(motion, departed=motion.departed + self.behind)
            departed = motion.departed if self.departed is None else self.departed
            pause = Pause.begun(ours, time)
            return dc.replace(
                self, pause=pause, motion=ours, behind=0.0, departed=departed
            )
        after = self.pause.go_on(time, state, reason, held)
        if isinstance(after, Pause):
            return dc.replace(self, pause=after)
        return dc.replace(self, motion=after, pause=None, answered=time)

    def broken_off(self, time: float, reason: str) -> Plan:
        """Return the plan after the planner is lost: the arm stops along its path."""
        status = dc.replace(
            self.status, mode=Mode.FAILED, failure=Failure.STOPPED, message=reason
        )
        motion = self.motion.stopped(time - self.behind)
        servoed = self.command is not ServoCommand.PASS
        command = ServoCommand.HOLD if servoed else self.command
        return dc.replace(self, motion=motion, status=status, command=command)

    def _goes_on(self, motion: Motion) -> bool:
        """Return whether a motion is the current one, now with a stop at its end."""
        departed = self.motion.departed if self.departed is None else self.departed
        return (
            motion.stopped_at is not None
            and self.motion.stopped_at is None
            and self.motion.trajectory is not None
            and motion.departed == departed
        )


class RemotePlanner(LeafSystem):
    """Stands in for a planner in another process.

    .. pydrake_system::

        name: RemotePlanner
        input_ports:
        - ROOM.MEASUREMENT (each of the station)
        - safety.state (optional)
        - arm.position_held (optional)
        - servo_status (optional)
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status
        - servo_command
        - sighting

    Every `planner_period`, the inputs go to the planner as a `Tick`. Every `period`,
    this system takes the planner's answers. `position_commanded` (N) [rad or m] follows
    the motion of the last answer even while the planner is busy. `closure_commanded`
    (1), `mode` and `status` are those of the last answer. If the planner ends, or does
    not answer for `patience`, the arm comes to rest along its path and the task has
    failed. Ports of an arm with a name begin with `NAME.`, as those of a station and of
    a `PlannerMachine`. A stop of one arm pauses all arms.

    While `safety.state` (2) of a monitor says that the arm is stopped, the planner's
    clock stands still: the planner gets no ticks, and the motion comes to rest. After
    the release, the motion continues where it was stopped. If the monitor has forgotten
    the path, the arm first returns to it from `arm.position_held` (N) [rad or m].

    The tracker of a visual servo is in the other process, too. `servo_status`
    (ServoStatus) goes to the planner with every tick. `servo_command` (ServoCommand)
    and `sighting` (a Sighting with its stamp, NaN unless the servo tracks) come with
    the answers. A servo in charge is told to hold while the arm is stopped, and when
    the planner ends or does not answer for half a second.

    Args:
        robots: The arms, at home at first.
        sizes: Sizes of the measurements, by name.
        period: Time between commands [s].
        planner_period: The planner's own period [s].
        patience: Longest time for a plan [s].
    """

    def __init__(
        self,
        planner: PlannerLink,
        robots: Sequence[RobotArm],
        sizes: Mapping[str, int],
        period: float,
        planner_period: float,
        patience: float = math.inf,
    ) -> None:
        super().__init__()
        self._planner, self._patience = planner, patience
        self._names = list(sizes)
        for name, size in sizes.items():
            self.DeclareVectorInputPort(name=name, size=size)
        homes = {own.name: np.array(own.arm.home) for own in robots if own.arm}
        self._safety, self._held = (
            {
                own.name: self.DeclareVectorInputPort(
                    port_of(own, name), size or len(homes[own.name])
                )
                for own in robots
            }
            for name, size in (("safety.state", 2), ("arm.position_held", None))
        )
        self._servo = self.DeclareAbstractInputPort(
            name="servo_status", model_value=AbstractValue.Make(ServoStatus())
        )
        plans = {name: Plan(Motion(home)) for name, home in homes.items()}
        self._plans = self.DeclareAbstractState(AbstractValue.Make(plans))
        ticket = self.abstract_state_ticket(self._plans)
        for own in robots:
            AddCommandOutputs(
                self,
                len(homes[own.name]),
                own.prefix,
                position=functools.partial(weak(self._calc_position), own.name),
                closure=functools.partial(weak(self._calc_closure), own.name),
                prerequisites={ticket},
            )
        AddStatusOutput(self, self._calc_status, {ticket})
        for name, model, calc, tickets in (
            ("mode", Mode.IDLE, self._calc_mode, {ticket}),
            (
                "servo_command",
                ServoCommand.PASS,
                self._calc_servo_command,
                {ticket, self.time_ticket()},
            ),
            ("sighting", Sighting(), self._calc_sighting, {ticket}),
        ):
            self.DeclareAbstractOutputPort(
                name, AbstractValue.Make(model).Clone, calc, tickets
            )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        self.DeclarePeriodicPublishEvent(planner_period, 0.0, self._post)

    def plans(self, context: Context) -> dict[str, Plan]:
        """Return the plan of each arm, by the arms' names."""
        state = context.get_abstract_state(int(self._plans))
        plans: dict[str, Plan] = state.get_value()
        return plans

    def plan(self, context: Context) -> Plan:
        """Return the plan of the first arm, whose status is that of the task."""
        return next(iter(self.plans(context).values()))

    def _calc_position(self, arm: str, context: Context, output: BasicVector) -> None:
        plan = self.plans(context)[arm]
        output.SetFromVector(plan.position(context.get_time()))

    def _calc_closure(self, arm: str, context: Context, output: BasicVector) -> None:
        output[0] = self.plans(context)[arm].closure

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.plan(context).status.mode)

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.plan(context).status)

    def _calc_servo_command(self, context: Context, output: AbstractValue) -> None:
        plan = self.plan(context)
        silent = context.get_time() - plan.answered > _SERVO_PATIENCE
        command = plan.command
        if command is not ServoCommand.PASS and (silent or plan.pause is not None):
            command = ServoCommand.HOLD
        output.set_value(command)

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.plan(context).sighting or Sighting())

    def _update(self, context: Context, state: State) -> EventStatus:
        before, time = self.plans(context), context.get_time()
        if self.plan(context).status.ended:
            return EventStatus.DidNothing()
        plans, broken = self._held_up(context, before), ""
        paused = any(plan.pause is not None for plan in plans.values())
        for message in () if paused else self._planner.take():
            if isinstance(message, Ended):
                broken = message.reason
                break
            plans[message.arm] = plans[message.arm].after(message, time)
        answered = min(plan.answered for plan in plans.values())
        if not broken and not paused and time - answered > self._patience:
            broken = f"the planner has not answered for {self._patience:g} s"
        if broken:
            plans = {name: p.broken_off(time, broken) for name, p in plans.items()}
        if all(plans[name] is before[name] for name in plans):
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(int(self._plans)).set_value(plans)
        return EventStatus.Succeeded()

    def _held_up(self, context: Context, plans: Mapping[str, Plan]) -> dict[str, Plan]:
        """Return the plans after a control period, in which an arm may be stopped."""
        ports, time = self._safety.values(), context.get_time()
        states = [safety_state(p.Eval(context)) for p in ports if p.HasValue(context)]
        if not states:
            return dict(plans)
        stops = [each for each in states if each[0] is not SafetyState.RUNNING]
        state, reason = [*stops, *states][0]
        return {
            name: plan.held_up(time, state, reason, self._held[name].Eval(context))
            for name, plan in plans.items()
        }

    def _post(self, context: Context) -> None:
        if any(plan.pause is not None for plan in self.plans(context).values()):
            return
        values = {name: self.GetInputPort(name).Eval(context) for name in self._names}
        servo = self._servo.Eval(context) if self._servo.HasValue(context) else None
        tick = Tick({name: np.array(v) for name, v in values.items()}, servo)
        self._planner.post(tick)
