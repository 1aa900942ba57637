"""A fixed list of arm motions and gripper commands, in place of a planner.

The list may be the messages that a client of the SRG thesis sends. These clients use
two topics: `/kuka`, joint positions of the arm [degrees], and `/grasp`, percent from 0
open to 100 closed. They send named routines of messages at a fixed rate, regardless of
the outcome.
"""

import bisect
import dataclasses as dc
from collections import Counter
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from drake_srg.common.exceptions import suggest
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.planning.planner_machine import (
    AddCommandOutputs,
    AddStatusOutput,
    PlannerConfig,
)
from drake_srg.types import Mode, PlannerStatus, Vector

# The modes that steps may have: those of a cycle in progress.
SCRIPT_MODES = tuple(
    mode.value
    for mode in Mode
    if mode not in (Mode.IDLE, Mode.VERIFY, Mode.DONE, Mode.FAILED)
)


@dc.dataclass(kw_only=True)
class ScriptStep(Config):
    """Commands that hold for a while."""

    # The mode that metrics and recordings show.
    mode: str = dc.field(default=Mode.TRANSFER.value, metadata={"among": SCRIPT_MODES})
    duration: float = dc.field(default=1.0, metadata=positive())  # s
    # Joint positions at the end of the step [rad or m]; null: the arm stays.
    arm: list[float] | None = None
    # Closure of the gripper during the step, 0 open .. 1 closed; null: as before.
    closure: float | None = dc.field(default=None, metadata={"ge": 0.0, "le": 1.0})
    # Messages that command the closure, evenly over the step from its beginning. Only
    # `gripper.underactuation.evaluate: per_message` counts them.
    messages: int = dc.field(default=1, metadata={"ge": 0})
    # Fraction of full PWM during the step; null: as before, and in the first steps the
    # driver's own limit.
    force_limit: float | None = dc.field(default=None, metadata={"ge": 0.0, "le": 1.0})


@dc.dataclass(kw_only=True)
class MessageConfig(Config):
    """Messages on one of the two topics."""

    # Joint positions [degrees], the same in all `count` messages; or else `grasp`.
    kuka: list[float] | None = None
    count: int = dc.field(default=1, metadata={"ge": 1})
    # First and last i of a ramp, up or down. Message i commands floor(i / 10) percent.
    grasp: list[int] | None = dc.field(
        default=None, metadata={"length": 2, "ge": 0, "le": 1000}
    )

    @property
    def number(self) -> int:
        """The number of messages."""
        return self.count if self.grasp is None else len(_ramp(self.grasp))


@dc.dataclass(kw_only=True)
class RoutineConfig(Config):
    """One routine of the sequence."""

    routine: str = ""
    # The mode that metrics and recordings show.
    mode: str = dc.field(default=Mode.TRANSFER.value, metadata={"among": SCRIPT_MODES})


@dc.dataclass(kw_only=True)
class MessagesConfig(Config):
    """Messages in the order in which they are sent, as routines."""

    rate: float = dc.field(default=25.0, metadata=positive())  # messages/s
    routines: dict[str, list[MessageConfig]] = dc.field(default_factory=dict)
    sequence: list[RoutineConfig] = dc.field(default_factory=list)
    # Time for the arm to come to rest after the last message [s].
    rest: float = dc.field(default=3.0, metadata=positive())

    def number(self) -> int:
        """Return the number of messages in the whole sequence."""
        calls = (self.routines[call.routine] for call in self.sequence)
        return sum(message.number for routine in calls for message in routine)


@dc.dataclass(kw_only=True)
class Script(PlannerConfig):
    """Steps for arm and gripper, in place of localizer and planner.

    Of the other keys, only `time_budget` applies.
    """

    steps: list[ScriptStep] = dc.field(default_factory=list)
    # Messages to arm and gripper, as the thesis's client sends them. Loading the
    # scenario turns them into `steps`. The arm moves to its targets within
    # `arm.limits`.
    messages: MessagesConfig | None = None


class ScriptedPlanner(LeafSystem):
    """Plays a script, regardless of the outcome.

    .. pydrake_system::

        name: ScriptedPlanner
        output_ports:
        - position_commanded
        - closure_commanded
        - closure_messages
        - force_limit
        - mode
        - status

    `position_commanded` (N) [rad or m] moves from rest to rest with minimum jerk. Each
    step starts where the one before it ended, the first at `home` at time 0.
    `closure_commanded` (1) and `force_limit` (1) change as soon as a step begins.
    `force_limit` is NaN, which means the driver's own limit, until a step sets one.
    `closure_messages` (1) is the number of messages so far that commanded a closure.
    `mode` (Mode) is that of the step, and DONE after the last. `status` (PlannerStatus)
    contains only the mode.

    Args:
        home: First position of the arm, shape (N,) [rad or m].
        script: The steps, at least one.
        jumps: Whether `position_commanded` also changes as soon as a step begins. It
            then needs a system that turns these jumps into motion.

    Raises:
        ValueError: If there is no step, or an arm position does not have N entries.
    """

    def __init__(
        self, home: Vector, script: Sequence[ScriptStep], *, jumps: bool = False
    ) -> None:
        super().__init__()
        if not script:
            raise ValueError("planner.steps: needs at least one step")
        n = len(home)
        for i, step in enumerate(script):
            if step.arm is not None and len(step.arm) != n:
                raise ValueError(
                    f"planner.steps[{i}].arm: needs one entry per joint of the arm "
                    f"({n}), got {len(step.arm)}"
                )
        self._script = list(script)
        self._jumps = jumps
        self._ends = np.cumsum([step.duration for step in script]).tolist()
        # Row i is where step i begins, the last row where the script ends.
        self._positions = _filled(
            np.asarray(home, dtype=float), [step.arm for step in script]
        )
        self._closures = _filled(0.0, [step.closure for step in script])[1:]
        # Messages of each step, and of all steps before it.
        self._messages = np.array(
            [0 if step.closure is None else step.messages for step in script]
        )
        self._messages_before = np.cumsum(self._messages) - self._messages
        self._force_limits = _filled(np.nan, [step.force_limit for step in script])[1:]

        time = {self.time_ticket()}
        AddCommandOutputs(
            self,
            n,
            position=self._calc_position,
            closure=self._calc_closure,
            prerequisites=time,
        )
        AddStatusOutput(self, self._calc_status, time)
        for name, calc in (
            ("closure_messages", self._calc_messages),
            ("force_limit", self._calc_force_limit),
        ):
            self.DeclareVectorOutputPort(
                name=name, size=1, calc=calc, prerequisites_of_calc=time
            )
        self.DeclareAbstractOutputPort(
            name="mode",
            alloc=lambda: AbstractValue.Make(Mode.IDLE),
            calc=self._calc_mode,
            prerequisites_of_calc=time,
        )

    def _step(self, context: Context) -> int:
        """Return the index of the present step, or one past the last."""
        # Times of updates are rounded multiples of a period. A time that was rounded
        # down must still count as the beginning of the next step.
        return bisect.bisect_right(self._ends, context.get_time() + 1e-9)

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        i = min(self._step(context), len(self._script) - 1)
        start, end = self._positions[i], self._positions[i + 1]
        if self._jumps:
            output.SetFromVector(end)
            return
        duration = self._script[i].duration
        s = (context.get_time() - self._ends[i]) / duration + 1.0
        output.SetFromVector(start + minimum_jerk_blend(s) * (end - start))

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        output[0] = self._closures[min(self._step(context), len(self._script) - 1)]

    def _calc_messages(self, context: Context, output: BasicVector) -> None:
        i = min(self._step(context), len(self._script) - 1)
        duration = self._script[i].duration
        # As in `_step`, a message belongs to the update at its time.
        share = (context.get_time() + 1e-9 - self._ends[i]) / duration + 1.0
        sent = min(np.floor(share * self._messages[i]) + 1.0, self._messages[i])
        output[0] = self._messages_before[i] + sent

    def _calc_force_limit(self, context: Context, output: BasicVector) -> None:
        output[0] = self._force_limits[min(self._step(context), len(self._script) - 1)]

    def _mode(self, context: Context) -> Mode:
        i = self._step(context)
        return Mode(self._script[i].mode) if i < len(self._script) else Mode.DONE

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._mode(context))

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(PlannerStatus(mode=self._mode(context), attempts=1))


def _filled(
    start: Vector | float, values: Sequence[list[float] | float | None]
) -> Vector:
    """Return `start` and the values, each None replaced by the value before it."""
    rows = [np.asarray(start)]
    for value in values:
        rows.append(rows[-1] if value is None else np.asarray(value, dtype=float))
    return np.array(rows)


def message_script(config: MessagesConfig, num_joints: int) -> list[ScriptStep]:
    """Return the script of all messages, one step per change of the command.

    Args:
        config: The messages.
        num_joints: Number of the arm's joints.

    Raises:
        ValueError: If there are no messages, a routine is unknown, or a message is not
            on exactly one topic or does not fit the arm.
    """
    for name, routine in config.routines.items():
        for i, message in enumerate(routine):
            key = f"planner.messages.routines.{name}[{i}]"
            if (message.kuka is None) == (message.grasp is None):
                raise ValueError(f"{key}: needs either kuka or grasp")
            if message.kuka is not None and len(message.kuka) != num_joints:
                raise ValueError(
                    f"{key}.kuka: needs one entry per joint of the arm "
                    f"({num_joints}), got {len(message.kuka)}"
                )
    steps: list[ScriptStep] = []
    for i, call in enumerate(config.sequence):
        if call.routine not in config.routines:
            raise ValueError(
                f"planner.messages.sequence[{i}].routine: unknown routine "
                f"{call.routine!r} {suggest(call.routine, config.routines)}"
            )
        for message in config.routines[call.routine]:
            steps += _steps(message, call.mode, 1.0 / config.rate)
    if not steps:
        raise ValueError("planner.messages.sequence: needs a routine with messages")
    return [*steps, ScriptStep(mode=steps[-1].mode, duration=config.rest)]


def _steps(message: MessageConfig, mode: str, period: float) -> list[ScriptStep]:
    if message.kuka is not None:
        arm = [float(q) for q in np.deg2rad(message.kuka)]
        return [ScriptStep(mode=mode, duration=message.count * period, arm=arm)]
    assert message.grasp is not None
    percents = [i // 10 for i in _ramp(message.grasp)]
    return [
        ScriptStep(
            mode=mode,
            duration=number * period,
            closure=percent / 100.0,
            messages=number,
        )
        for percent, number in Counter(percents).items()
    ]


def _ramp(ends: list[int]) -> range:
    first, last = ends
    step = 1 if last >= first else -1
    return range(first, last + step, step)
