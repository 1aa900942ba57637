"""The planner that grasps with a visual servo: its modes and system."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    FATAL,
    TRANSITIONS,
    PlannerMemory,
    Senses,
    Trouble,
)
from drake_srg.planning.pick_and_place.modes import (
    Close,
    Entry,
    Grasp,
    Idle,
    Lift,
    Now,
    TaskMode,
    Verify,
    task_modes,
)
from drake_srg.planning.pick_and_place.planner import PickAndPlacePlanner
from drake_srg.planning.pick_and_place.sightings import PickTask
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.planning.planner_machine import Observation, Table, Transitions
from drake_srg.planning.servoing.config import (
    ServoCommand,
    ServoFault,
    Servoing,
    ServoState,
    ServoStatus,
)
from drake_srg.types import AnyMode, Blob, Failure, Mode

# The servo's command in each mode; it passes in all others.
COMMANDS: Mapping[AnyMode, ServoCommand] = {
    Mode.GRASP: ServoCommand.TRACK,
    Mode.CLOSE: ServoCommand.FOLLOW,
    Mode.VERIFY: ServoCommand.FOLLOW,
    Mode.LIFT: ServoCommand.RAISE,  # until the rest is planned
}
# The servo's transitions come before those of picking and placing.
SERVO_TRANSITIONS: Table = {
    **TRANSITIONS,
    Mode.GRASP: [
        (lambda o, t, c: o.stuck, Mode.RETREAT),
        *TRANSITIONS[Mode.GRASP],
    ],
    Mode.LIFT: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        *TRANSITIONS[Mode.LIFT],
    ],
}
servo_transition = Transitions(SERVO_TRANSITIONS, FATAL)
_HELD = (ServoState.HOLDING, ServoState.FAILED)
_LATE = "it does not reach the object in time"


@dc.dataclass(frozen=True)
class ServoSenses(Senses):
    """Measurements at one time, and the servo's report."""

    servo: ServoStatus = dc.field(default_factory=ServoStatus)


def servo_command(mode: AnyMode, memory: PlannerMemory) -> ServoCommand:
    """Return the servo's command in a mode."""
    if mode is Mode.GRASP and memory.trouble.failure is not None:
        return ServoCommand.HOLD  # the retreat begins where the hand rests
    if mode is Mode.LIFT and memory.attempt.looked:
        return ServoCommand.PASS
    return COMMANDS.get(mode, ServoCommand.PASS)


@dc.dataclass
class ServoingMemory(PlannerMemory):
    """The memory of picking and placing, and the latest sighting while idle."""

    before: Blob | None = None
    before_at: float = 0.0  # s


class ServoIdle(Idle):
    """Waits for the object to be in the window, and plans all motions."""

    mode = Mode.IDLE
    config: Servoing

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Look twice, and plan for the place where the object will be."""
        window = self.config.window
        if window is None:
            super().look(memory, now)
            return
        assert isinstance(memory, ServoingMemory), "these modes need its memory"
        view = now.senses.see()
        blob, elapsed = self.replanner.find(view), now.time - memory.before_at
        # A sighting of an earlier attempt does not count.
        before = memory.before if memory.before_at >= memory.attempt.began else None
        memory.before, memory.before_at = blob, now.time
        if blob is None or before is None or not window.contains(blob.position):
            place = "planner.window, or seen only once"
            self.replanner.wait(view, memory, now.time, place)
            return
        v_WO = (blob.position - before.position) / elapsed
        self.replanner.plan(view, memory, now.time, window.lead_time * v_WO)


class Servoed(TaskMode):
    """A mode in which the servo moves the arm."""

    def trajectory(self, memory: PlannerMemory) -> Trajectory | None:
        """Return None, because the servo moves the arm."""
        return None

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Update the planner's motion to rest at the servo's commands."""
        memory, q = super().update(memory, now), _servo(now).q
        if len(q):
            memory.motion = Motion(q)
        return memory


class ServoGrasp(Servoed, Grasp):
    """Lets the servo move the open hand around the object."""

    mode = Mode.GRASP
    config: Servoing

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Plan a retreat once the servo has failed and the hand rests."""
        memory, servo = super().update(memory, now), _servo(now)
        attempt = memory.attempt
        if attempt.escape is not None:
            return memory
        failed = servo.state is ServoState.FAILED
        late = now.time - attempt.ready_at > self.config.servo.time_limit
        if memory.trouble.failure is None and (failed or late):
            seen = servo.fault not in (None, ServoFault.STUCK)
            why = servo.fault.value if servo.fault is not None and failed else _LATE
            failure = Failure.NOT_SEEN if seen else Failure.OUT_OF_REACH
            memory.trouble = Trouble(failure, f"visual servo: {why}")
        if memory.trouble.failure is not None and servo.at_rest:
            self.replanner.escape(memory, now.time)
        return memory

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report that the hand has reached the object, or that a retreat is planned."""
        attempt = memory.attempt
        if attempt.escape is not None:
            return Observation(stuck=now.time >= attempt.ready_at)
        return Observation(arrived=_servo(now).state is ServoState.REACHED)


class ServoClose(Servoed, Close):
    """Closes the fingers on the object while the hand follows it."""

    mode = Mode.CLOSE


class ServoVerify(Servoed, Verify):
    """Verifies that the fingers hold the object while the hand follows it."""

    mode = Mode.VERIFY


class ServoLift(Lift):
    """Lets the servo raise the hand a little, plans the rest from there, and lifts."""

    mode = Mode.LIFT

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the fingers' hold on the object, and brake."""
        memory = super().enter(memory, entry)
        memory.motion = Motion(_servo(entry).q)
        return memory

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Plan once the hand is at rest; the motion begins when the plan is ready."""
        servo = _servo(now)
        memory.motion, attempt = Motion(servo.q), memory.attempt
        if servo.state not in _HELD or not servo.at_rest:
            return
        self.replanner.carry(memory, now.time)
        attempt.looked = True
        if not attempt.trapped:
            memory.motion = memory.motion.followed_by(
                attempt.planned.motions[self.mode], attempt.ready_at, self.wait
            )

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report a failed plan, or the end of the lift."""
        if memory.attempt.trapped:
            return Observation(failure=memory.trouble.failure)
        if not memory.attempt.looked:
            return Observation()
        return super().observe_mode(memory, now)


_KINDS = (ServoIdle, ServoGrasp, ServoClose, ServoVerify, ServoLift)


def _servo(now: Now) -> ServoStatus:
    assert isinstance(now.senses, ServoSenses), "these modes need a servo"
    return now.senses.servo


class ServoingPlanner(PickAndPlacePlanner):
    """Picks and places like its base class, but leaves the grasp to a visual servo.

    .. pydrake_system::

        name: ServoingPlanner
        input_ports:
        - blobs
        - arm_state
        - gripper_state
        - grasped
        - proximity
        - obstacles (optional)
        - external_torque (optional)
        - servo_status
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status
        - servo_command

    The other ports are those of `PickAndPlacePlanner`. `servo_status` (ServoStatus) and
    `servo_command` (ServoCommand) connect to a `VisualServo`, which passes on
    `position_commanded` unless it moves the arm itself.

    In front of the object, the planner hands over to the servo, and closes the fingers
    once the servo has reached the object. Meanwhile, the servo follows the object's
    last motion. Once the grasp is verified, the servo raises the hand a little and
    brakes, and the planner plans the rest of the cycle from there. If the servo fails,
    the planner draws the hand back, goes home and tries again.

    Args:
        task_planner: Plans the motions.
        task: The object to take, and its goal.
        config: Times, speeds and limits.
    """

    def __init__(
        self, task_planner: TaskPlanner, task: PickTask, config: Servoing
    ) -> None:
        super().__init__(
            task_planner,
            task,
            config,
            make_modes=functools.partial(task_modes, kinds=_KINDS),
            transition=servo_transition,
            make_memory=ServoingMemory,
        )
        self._servo = self.DeclareAbstractInputPort(
            name="servo_status", model_value=AbstractValue.Make(ServoStatus())
        )
        self.DeclareAbstractOutputPort(
            name="servo_command",
            alloc=lambda: AbstractValue.Make(ServoCommand.PASS),
            calc=self._calc_command,
            prerequisites_of_calc={self.state_ticket},
        )

    def sense(self, context: Context) -> ServoSenses:
        """Return the measurements, and the servo's report."""
        senses = super().sense(context)
        return ServoSenses(**vars(senses), servo=self._servo.Eval(context))

    def _calc_command(self, context: Context, output: AbstractValue) -> None:
        state = self.state(context)
        output.set_value(servo_command(state.mode, state.memory))
