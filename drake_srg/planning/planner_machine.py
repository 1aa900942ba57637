"""Base of all planners: modes, and the system that runs them.

A planner consists of its knowledge (a `MotionMemory`), its transitions (`Transitions`),
and the actions of its modes (`PlannerMode`). `PlannerMachine` runs it.
"""

import abc
import contextlib
import dataclasses as dc
import functools
import time as wall
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import ClassVar, Generic, TypeAlias, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DependencyTicket
from pydrake.trajectories import Trajectory

from drake_srg.config import positive
from drake_srg.lifetime import LeafSystem, weak
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.limits import MotionConfig
from drake_srg.planning.state_machine import (
    Entry,
    Memory,
    ModeActions,
    Moment,
    SensesT,
    StateMachine,
    next_mode,
)
from drake_srg.types import AnyMode, Failure, Mode, PlannerStatus, Vector

# Reasons for which any planner gives up, in words.
GIVES_UP: Mapping[Failure, str] = {
    Failure.STOPPED: "the arm does not reach its destination; something blocks it",
    Failure.TIME_BUDGET: "the time budget is used up",
}
_STILL = 0.05  # joint speed below which the fingers rest [rad/s]
_CLEAR = 0.001  # distance at which resting fingers have let go of an object [m]
# Time between looks for an object that is not seen [s]. By default, there are 3 looks.
SEARCH_PERIOD = 0.25
# A carried object is lost once the gripper's joints have closed by this much on average
# in `slip_time` [rad]. Fingers around an object yield to each other, which does not
# change the average. It changed by less than 0.001 rad with a can between fingertips,
# and by 0.01 rad when wrapped fingers settled. Fingers that lose a can close by 0.1
# rad.
SLIP_CLOSING = 0.03

SeenT = TypeVar("SeenT")


@dc.dataclass(kw_only=True)
class PlannerConfig(MotionConfig):
    """Configuration of a planner and its motions. Times are simulated.

    Each planner has a derived class, whose name is the tag in scenario files.
    """

    # Simulated duration of planning, from a decision to the first motion [s].
    latency: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Grasps to try before giving up.
    max_attempts: int = dc.field(default=3, metadata={"ge": 1})
    # Longest duration of a cycle before giving up [s].
    time_budget: float = dc.field(default=40.0, metadata=positive())
    # Time to look for an object [s].
    search_time: float = dc.field(default=0.5, metadata={"ge": 0.0})
    # Directions from which to take objects.
    approaches: list[str] = dc.field(
        default_factory=lambda: ["above", "side"],
        metadata={"among": ("above", "side")},
    )
    # Tilts of the hand below the horizontal in grasps from the side [rad]: 0, 3, 5 or
    # 10 degrees. A tilt keeps the wrist off the table, but tilts the object in the
    # hand.
    tilts: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.05, 0.0873, 0.1745],
        metadata={"ge": 0.0, "le": 0.7},
    )
    # Closing command beyond contact, base + tip [rad]. 0.4 rad presses with about 14 N
    # per finger (see `SrgPositionDriver`'s gains), more than four times what a can of
    # 0.42 kg needs at friction 0.6.
    squeeze: float = dc.field(default=0.4, metadata=positive())
    # Distances that the arm and the hand keep from their surroundings [m].
    clearance: float = dc.field(default=0.01, metadata=positive())
    hand_clearance: float = dc.field(default=0.005, metadata=positive())
    # Height above the table at which to let go of the object [m]: more than the error
    # of the localisation, so that the object is not pressed into the table. Raise it
    # for cameras with larger errors.
    place_height: float = dc.field(default=0.0005, metadata={"ge": 0.0})
    # Half the plant's step h [s]: before it places an object, the planner subtracts the
    # object's drift in the hand that the simulation's steps cause; see `carried_drift`.
    # 0 for a robot, and for steps so short that the drift does not matter.
    drift_time: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Mass in the hand for which the torque limits must suffice [kg].
    payload: float = dc.field(default=0.5, metadata={"ge": 0.0})
    # If the arm is late by more than this, something must have stopped it [s].
    arrival_timeout: float = dc.field(default=1.0, metadata=positive())
    # Greatest path error of a joint while the hand pushes things on a table, or sets
    # one down [rad]. Beyond it, the planner concludes that something stopped the arm;
    # null: the arm presses on until `arrival_timeout`. Delay alone gives the simulated
    # iiwa errors of up to 0.021 rad.
    path_tolerance: float | None = dc.field(default=None, metadata=positive())
    # Protective stop: external torques (see `AddExternalTorque`) that end the task
    # while the arm moves, one per joint [N m]; null: no limits. Leave room for carried
    # objects: with a can, the fast kitchen's iiwa 14 feels up to 4 N m, at its wrist
    # 0.3 N m; with a cylinder, the five-axis arm feels 0.12 N m. Errors of the sensors
    # add to that. Contact at the very end of setting an object down does not count.
    max_external_torque: list[float] | None = dc.field(
        default=None, metadata=positive()
    )
    # Time in which the fingers begin to move after a command [s]. It must exceed the
    # delays of the gripper's bus and servo, or open fingers beside an object count as
    # closed.
    gripper_reaction: float = dc.field(default=0.2, metadata={"ge": 0.0})
    # Time that the fingers may take to close or open [s].
    gripper_timeout: float = dc.field(default=1.5, metadata=positive())
    # Time for which the grasp is checked, before and after lifting [s].
    verify_time: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # A carried object is lost once nothing has been sensed between the fingers for this
    # long [s]. It must be longer than `grasp_detector.post_contact_delay`, so that one
    # missed reading of a sensor does not count.
    slip_time: float = dc.field(default=0.15, metadata=positive())
    # Whether to look again when the hand is in front of the object, and to plan again
    # if it has moved. Useful with cameras that see it there.
    look_before_grasp: bool = False
    # Whether to look at the object in the hand above the goal, and to plan its placing
    # from there. Useful with cameras that see it there.
    look_before_place: bool = False
    # Shortest waits of the arm [s]: with closed fingers before it lifts or pulls, with
    # open fingers before it leaves, and at home. After clearing a table, the last one
    # counts from the last release.
    grip_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    release_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    home_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Time for the empty fingers to close at home [s]; 0 leaves them open.
    close_at_home: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Whether an arm that clears a table cuts corners: it then does not rest between two
    # motions, and the second must begin on time. On a robot, and with a safety monitor,
    # which may slow the arm, it always rests.
    cut_corners: bool = False
    # Time between evaluations of the state machine [s].
    period: float = dc.field(default=0.01, metadata=positive())

    # Whether the planner moves several arms. Its ports then begin with their names.
    several_arms: ClassVar[bool] = False

    @property
    def feels(self) -> bool:
        """Whether the planner needs the external torques of its arms."""
        return self.max_external_torque is not None


@dc.dataclass(kw_only=True)
class PickAndPlace(PlannerConfig):
    """Picks the object that `task.pick` names, and sets it down on its goal."""


@dc.dataclass(kw_only=True)
class Clear(PlannerConfig):
    """Clears things of any shape off the table, one after another.

    Two `arms` clear it at the same time, each into a bin on its own side.
    """

    several_arms: ClassVar[bool] = True


@dc.dataclass(frozen=True)
class HandSenses(Generic[SeenT]):
    """Measurements of an arm with a gripper at one time."""

    q: Vector  # the arm's joints, shape (N,) [rad]
    fingers: Vector  # the gripper's joints, shape (n,) [rad]
    finger_speeds: Vector  # shape (n,) [rad/s]
    grasped: bool  # both fingers sense something
    proximity: Vector  # shape (m,) [m]
    see: Callable[[], SeenT]  # reads the cameras, which is slow

    @property
    def still(self) -> bool:
        """Whether the fingers have come to rest."""
        return bool(np.max(np.abs(self.finger_speeds)) < _STILL)

    @property
    def clear(self) -> bool:
        """Whether nothing is near the fingers."""
        return bool(np.min(self.proximity) > _CLEAR)


@dc.dataclass(frozen=True)
class Observation:
    """Facts that decide the next mode; each mode sets only those of its table row."""

    ready: bool = False  # motions are planned, and the planning latency has passed
    pushing: bool = False  # a push is planned, and the planning latency has passed
    finished: bool = False  # no grasp fits anything that is left
    unseen: bool = False  # the last load was not seen where it belongs
    arrived: bool = False  # the mode's motion is over, and the arm has followed it
    stuck: bool = False  # the arm cannot go on as planned
    astray: bool = False  # the arm is still where something stopped it
    moved: bool = False  # the object has left the place of the planned grasp
    placing: bool = False  # the load is to be set down, not dropped
    still: bool = False  # the fingers have come to rest
    holding: bool = False  # the target is between the fingers
    clear: bool = False  # nothing is near the fingers
    at_goal: bool = False  # the object has been seen on its goal
    last_cycle: bool = True  # no cycle follows this one
    failure: Failure | None = None  # the reason to give up


# mode: [(condition on the observation o, the time t in the mode [s] and the planner's
#         configuration c; next mode)]. The first condition that holds decides.
Condition: TypeAlias = Callable[[Observation, float, PlannerConfig], bool]
Table: TypeAlias = Mapping[AnyMode, Sequence[tuple[Condition, AnyMode]]]


@dc.dataclass(frozen=True)
class Transitions:
    """Transitions between the modes of a planner, as a pure function.

    Attributes:
        table: The transitions. Keys may be modes of your own.
        fatal: Failures that lead from every mode to FAILED. The table handles all
            others.

    Raises:
        ValueError: If a mode that follows another one has no row.
    """

    table: Table
    fatal: Collection[Failure] = tuple(Failure)

    def __post_init__(self) -> None:
        for mode, row in self.table.items():
            for _, following in row:
                if following not in self.table:
                    known = ", ".join(map(str, self.table))
                    raise ValueError(
                        f"transitions: {mode} leads to {following}, which has no row "
                        f"(allowed: {known})"
                    )

    def check_actions(self, modes: Collection[AnyMode]) -> None:
        """Check that a planner has actions for all modes of the table.

        Raises:
            ValueError: If a mode of the table is missing.
        """
        missing = [str(mode) for mode in self.table if mode not in modes]
        if missing:
            raise ValueError(
                f"modes: no actions for {', '.join(missing)}, needed by the "
                f"transitions (allowed: {', '.join(map(str, modes))})"
            )

    def __call__(
        self,
        mode: AnyMode,
        observation: Observation,
        t: float,
        config: PlannerConfig | None = None,
    ) -> AnyMode:
        """Return the mode that follows.

        Args:
            mode: The mode now.
            observation: The mode's observation.
            t: Time since the mode began [s].
            config: Waits and times of the gripper; None: the defaults.
        """
        if observation.failure in self.fatal:
            return mode if mode in (Mode.DONE, Mode.FAILED) else Mode.FAILED
        return next_mode(self.table, mode, observation, t, config or PlannerConfig())


@dc.dataclass
class MotionMemory(Memory, abc.ABC):
    """Base class of planners' memories: the commands."""

    motion: Motion  # the arm's; at first, it rests at home
    closure: float = 0.0  # commanded, 0 open .. 1 closed

    @abc.abstractmethod
    def status(self, mode: AnyMode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""


MotionMemoryT = TypeVar("MotionMemoryT", bound=MotionMemory)


class PlannerMode(ModeActions[AnyMode, MotionMemoryT, SensesT, Observation]):
    """A mode of a planner: its motion, commands and observations.

    Attributes:
        mode: Its own mode.
    """

    mode: ClassVar[AnyMode]

    @property
    def wait(self) -> float:
        """Least duration of the mode after its motion [s]."""
        return 0.0

    def trajectory(self, memory: MotionMemoryT) -> Trajectory | None:
        """Return the planned motion of the mode; None if the arm rests."""
        return None

    def enter(
        self, memory: MotionMemoryT, entry: Entry[SensesT, AnyMode, Observation]
    ) -> MotionMemoryT:
        """Begin the mode's planned motion, if there is one."""
        trajectory = self.trajectory(memory)
        memory.motion = memory.motion.followed_by(trajectory, entry.time, self.wait)
        return memory

    def observe(self, memory: MotionMemoryT, now: Moment[SensesT]) -> Observation:
        """Return the facts on which the mode's transitions depend, and no others."""
        failure = self.final_failure(memory, now.time)
        if failure is not None:
            return Observation(failure=failure)
        return self.observe_mode(memory, now)

    def final_failure(self, memory: MotionMemoryT, time: float) -> Failure | None:
        """Return the failure that ends the task in any mode, or None."""
        return None

    def observe_mode(self, memory: MotionMemoryT, now: Moment[SensesT]) -> Observation:
        """Return the observation for the mode's own transitions."""
        return Observation()


class PlannerMachine(
    StateMachine[AnyMode, MotionMemoryT, SensesT, Observation],
    Generic[MotionMemoryT, SensesT],
):
    """Base class of planners, which begin in IDLE; their memory has the commands.

    Its modes may be ours, members of your own enum, strings, or a mixture. A run ends
    once the planner is in a mode named `done` or `failed`.

    Its outputs are `mode`, `status` and those of `AddCommandOutputs`. Derive from it:
    declare the inputs after calling `__init__`, and override `sense`.

    Args:
        modes: Actions of each mode.
        memory: The memory on entering IDLE; its motion rests at home.
        transition: Returns the mode that follows from (mode, observation, time in the
            mode [s], config).
        config: Its period is the time between updates.
        arms: Names of the arms, which have equal numbers of joints. The ports of an arm
            with a name begin with `NAME.`.
        together: Whether the memory's motion has the joints of all arms, one arm after
            the other.

    Raises:
        ValueError: If `transition` is a `Transitions` that leads to a mode without
            actions.
    """

    def __init__(
        self,
        modes: Mapping[
            AnyMode, ModeActions[AnyMode, MotionMemoryT, SensesT, Observation]
        ],
        *,
        memory: MotionMemoryT,
        transition: Callable[[AnyMode, Observation, float, PlannerConfig], AnyMode],
        config: PlannerConfig,
        arms: Sequence[str] = ("",),
        together: bool = False,
    ) -> None:
        if isinstance(transition, Transitions):
            transition.check_actions(modes)
        super().__init__(
            modes,
            initial=Mode.IDLE,
            memory=memory,
            transition=lambda mode, o, t: transition(mode, o, t, config),
            period=config.period,
        )
        self._n, self._n_fingers = len(memory.motion.q_rest), 0
        self._own = {arm: slice(None) for arm in arms}  # joints of the motion
        if together:
            self._n //= len(arms)
            for i, arm in enumerate(arms):
                self._own[arm] = slice(i * self._n, (i + 1) * self._n)
        for arm in arms:
            AddCommandOutputs(
                self,
                self._n,
                f"{arm}." if arm else "",
                position=functools.partial(weak(self._calc_position), arm),
                closure=functools.partial(weak(self._calc_closure), arm),
                prerequisites={self.state_ticket},
            )
        AddStatusOutput(self, self._calc_status, {self.state_ticket})

    def own_joints(self, arm: str) -> slice:
        """Return an arm's joints among those of the motion from `commands`."""
        return self._own[arm]

    def commands(self, memory: MotionMemoryT, arm: str) -> tuple[Motion, float]:
        """Return the motion and the commanded closure of an arm.

        Override it for several arms.

        Args:
            memory: The planner's.
            arm: The arm's name; empty: the only arm.
        """
        return memory.motion, memory.closure

    def declare_hand_inputs(
        self, num_fingers: int, num_sensors: int, prefix: str = ""
    ) -> None:
        """Declare the inputs that `hand_senses` reads.

        They are `arm_state` (2N) and `gripper_state` (2n), [q; v] in rad and rad/s;
        `grasped` (1), nonzero once both fingers sense something; `proximity` (m),
        signed distances [m].

        Args:
            num_fingers: Number n of the gripper's measured joints.
            num_sensors: Number m of its proximity readings.
            prefix: Prefix of the ports' names.
        """
        self._n_fingers = num_fingers
        for name, size in (
            ("arm_state", 2 * self._n),
            ("gripper_state", 2 * num_fingers),
            ("grasped", 1),
            ("proximity", num_sensors),
        ):
            self.DeclareVectorInputPort(name=f"{prefix}{name}", size=size)

    def hand_senses(
        self, context: Context, see: Callable[[], SeenT], prefix: str = ""
    ) -> HandSenses[SeenT]:
        """Return the measurements at the inputs of `declare_hand_inputs`.

        Args:
            context: The planner's.
            see: Reads the cameras; called only when a mode looks.
            prefix: Prefix of the ports' names.
        """

        def read(name: str) -> Vector:
            value: Vector = self.GetInputPort(f"{prefix}{name}").Eval(context)
            return value

        gripper = read("gripper_state")
        return HandSenses(
            q=read("arm_state")[: self._n],
            fingers=gripper[: self._n_fingers],
            finger_speeds=gripper[self._n_fingers :],
            grasped=bool(read("grasped")[0]),
            proximity=read("proximity"),
            see=see,
        )

    def _calc_position(self, arm: str, context: Context, output: BasicVector) -> None:
        motion, _ = self.commands(self.state(context).memory, arm)
        output.SetFromVector(motion.position(context.get_time())[self._own[arm]])

    def _calc_closure(self, arm: str, context: Context, output: BasicVector) -> None:
        _, output[0] = self.commands(self.state(context).memory, arm)

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        state = self.state(context)
        output.set_value(state.memory.status(state.mode))


def AddCommandOutputs(
    planner: LeafSystem,
    num_joints: int,
    prefix: str = "",
    *,
    position: Callable[[Context, BasicVector], None],
    closure: Callable[[Context, BasicVector], None],
    prerequisites: set[DependencyTicket],
) -> None:
    """Add the outputs `position_commanded` and `closure_commanded` of one arm.

    Args:
        planner: The planner; it declares its `mode` itself.
        num_joints: Number of the arm's joints.
        prefix: Prefix of the ports' names.
        position: Calculates the joint positions (num_joints) [rad or m]. They also
            depend on time.
        closure: Calculates the closure (1), 0 open .. 1 closed.
        prerequisites: Tickets that both depend on.
    """
    for name, size, calc, tickets in (
        ("position_commanded", num_joints, position, {planner.time_ticket()}),
        ("closure_commanded", 1, closure, set()),
    ):
        planner.DeclareVectorOutputPort(
            name=f"{prefix}{name}",
            size=size,
            calc=calc,
            prerequisites_of_calc=prerequisites | tickets,
        )


def AddStatusOutput(
    planner: LeafSystem,
    status: Callable[[Context, AbstractValue], None],
    prerequisites: set[DependencyTicket],
) -> None:
    """Add the output `status`.

    Args:
        planner: The planner.
        status: Calculates the `PlannerStatus`.
        prerequisites: Tickets that it depends on.
    """
    planner.DeclareAbstractOutputPort(
        name="status",
        alloc=lambda: AbstractValue.Make(PlannerStatus()),
        calc=status,
        prerequisites_of_calc=prerequisites,
    )


class _PlanningClock:
    """Wall-clock time that this process has spent on planning.

    Like `time.process_time`, it is not part of any simulation: contexts neither hold it
    nor depend on it, so equal seeds give equal bytes. The caller of a simulation takes
    the difference between two readings.
    """

    def __init__(self) -> None:
        self._seconds = 0.0

    def __call__(self) -> float:
        """Return the time so far [s]."""
        return self._seconds

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Count the time within the context as planning."""
        start = wall.perf_counter()
        try:
            yield
        finally:
            self._seconds += wall.perf_counter() - start


planning_clock = _PlanningClock()
