"""The planner of the five-axis arm's thesis: taught waypoints P0 to P4, and one look.

`TRANSITIONS` is the table of modes and their successors. The classes of the modes
define their actions.
"""

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, TypeAlias

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.motion.arm_model import restores_fingers
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import (
    NoPathError,
    PlanningFailure,
    PlanningScene,
)
from drake_srg.planning.planner_machine import (
    SEARCH_PERIOD,
    MotionMemory,
    Observation,
    PlannerConfig,
    PlannerMachine,
    PlannerMode,
    Table,
    Transitions,
    planning_clock,
)
from drake_srg.types import AnyMode, Blob, Failure, Mode, PlannerStatus, Vector

_UP = np.array([0.0, 0.0, 1.0])
_ANGLE = 0.002  # tolerance of the hand's z from the vertical [rad]


@dc.dataclass(kw_only=True)
class Taught(PlannerConfig):
    """The waypoints P0 to P4 of the five-axis arm's thesis; P0 is `arm.home`.

    P2 is the position from the localizer, with the hand's z up. The arm avoids no
    obstacles.
    """

    # P1 minus P2 in world [m].
    approach: list[float] = dc.field(
        default_factory=lambda: [0.025, 0.0, 0.0], metadata={"length": 3}
    )
    # Joint positions of P3, at which the object is lifted, and of P4, at which it is
    # released [rad].
    lift: list[float] = dc.field(default_factory=list, metadata={"nonempty": True})
    place: list[float] = dc.field(default_factory=list, metadata={"nonempty": True})
    # P2 in world [m]; null: the position from the localizer.
    grasp: list[float] | None = dc.field(default=None, metadata={"length": 3})


class TaughtMotions:
    """Plans the motions P0, P1, P2, P3, P4, P0; keeps no state between calls.

    `moves`, `q_home` and `config` are public attributes.

    Args:
        scene: The arm, the gripper and the furniture.
        moves: The moves in that scene.
        q_home: P0, shape (N,) [rad].
        config: The other waypoints, and the waits.

    Raises:
        ValueError: If a taught posture does not have N entries.
    """

    def __init__(
        self, scene: PlanningScene, moves: Moves, q_home: Vector, config: Taught
    ) -> None:
        for name in ("lift", "place"):
            count = len(getattr(config, name))
            if count != len(q_home):
                raise ValueError(
                    f"planner.{name}: needs one entry per joint of the arm "
                    f"({len(q_home)}), got {count}"
                )
        self.scene = scene
        self.moves = moves
        self.q_home = np.asarray(q_home, dtype=float)
        self.config = config

    @restores_fingers
    def plan(self, p_WT: Vector) -> Mapping[AnyMode, Trajectory] | PlanningFailure:
        """Plan the motion of each mode that moves the arm.

        Args:
            p_WT: P2, the tip's position for the grasp, shape (3,) [m].
        """
        try:
            return self._plan(p_WT)
        except NoPathError as error:
            return error.failure

    def _plan(self, p_WT: Vector) -> dict[AnyMode, Trajectory]:
        self.scene.SetFingers({})
        p_2 = np.asarray(p_WT)
        q_2 = self._reach(p_2, self.q_home)
        q_1 = self._reach(p_2 + np.array(self.config.approach), q_2)
        q_3, q_4 = np.array(self.config.lift), np.array(self.config.place)
        free, holding = self.moves.free, self.moves.holding
        legs = (
            (Mode.PRE_GRASP, self.q_home, q_1, free),
            (Mode.GRASP, q_1, q_2, free),
            (Mode.LIFT, q_2, q_3, holding),
            (Mode.PLACE, q_3, q_4, holding),
            (Mode.HOME, q_4, self.q_home, free),
        )
        return {
            mode: self.moves.timed(self.moves.joint_path(start, end), limits)
            for mode, start, end, limits in legs
        }

    def _reach(self, p_WT: Vector, q_nominal: Vector) -> Vector:
        """Return the posture with the tip at `p_WT` [m] and the hand's z up."""
        axis = AxisTarget(_UP, _UP, angle=_ANGLE)
        target = HandTarget(p_WT, axes=(axis,), p_GT=self.moves.p_GT)
        found = solve_inverse_kinematics(self.scene, target, q_nominal=q_nominal)
        if isinstance(found, IkFailure):
            raise NoPathError(PlanningFailure(found.failure, found.message))
        return found.q


@dc.dataclass(frozen=True)
class Senses:
    """Measurements of the planner."""

    q: Vector  # the arm's joints, shape (N,) [rad]
    gripped: bool  # both fingers sense something
    see: Callable[[], Sequence[Blob]]  # evaluates the localizer's output


@dc.dataclass
class TaughtMemory(MotionMemory):
    """The planner's state."""

    motions: Mapping[AnyMode, Trajectory] = dc.field(default_factory=dict)
    gripped_since: float = np.inf  # s
    ready_at: float = np.inf  # when the planned motions may begin [s]
    next_look: float = 0.0  # s
    report: PlannerStatus = dc.field(default_factory=PlannerStatus)

    def status(self, mode: AnyMode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""
        return dc.replace(self.report, mode=mode)


Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, AnyMode, Observation]

# The thesis calls the modes IDLE, GOTO_P1, GOTO_P2, GRASP, GOTO_P3, GOTO_P4, RELEASE,
# GOTO_P0 with CLOSE_AT_HOME, and END. The conditions take the observation o, the time t
# in the mode [s] and the planner's configuration c.
TRANSITIONS: Table = {
    Mode.IDLE: [(lambda o, t, c: o.ready, Mode.PRE_GRASP)],
    Mode.PRE_GRASP: [(lambda o, t, c: o.arrived, Mode.GRASP)],
    Mode.GRASP: [(lambda o, t, c: o.arrived, Mode.CLOSE)],
    Mode.CLOSE: [(lambda o, t, c: o.holding, Mode.LIFT)],
    Mode.LIFT: [(lambda o, t, c: o.arrived, Mode.PLACE)],
    Mode.PLACE: [(lambda o, t, c: o.arrived, Mode.RELEASE)],
    Mode.RELEASE: [(lambda o, t, c: t >= c.release_wait, Mode.HOME)],
    Mode.HOME: [(lambda o, t, c: o.arrived, Mode.DONE)],
    Mode.DONE: [],
    Mode.FAILED: [],
}
transition = Transitions(TRANSITIONS)


class TaughtMode(PlannerMode[TaughtMemory, Senses]):
    """A mode that moves the arm or waits, and commands the fingers.

    Attributes:
        commands: Closure commanded at the mode's beginning, 0 open .. 1 closed; None
            leaves it unchanged.
        planner: Plans the motions.
        config: Waits and limits.
        name: Name of the blob to take.
    """

    commands: ClassVar[float | None] = None

    def __init__(self, planner: TaughtMotions, name: str) -> None:
        self.planner = planner
        self.config = planner.config
        self.name = name

    def trajectory(self, memory: TaughtMemory) -> Trajectory | None:
        """Return the planned motion of the mode; None if the arm rests."""
        return memory.motions.get(self.mode)

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Begin the mode's motion and command the fingers."""
        memory.gripped_since = np.inf
        if self.commands is not None:
            memory.closure = self.commands
        return super().enter(memory, entry)

    def update(self, memory: TaughtMemory, now: Now) -> TaughtMemory:
        """Record since when both fingers have sensed contact."""
        since = min(memory.gripped_since, now.time)
        memory.gripped_since = since if now.senses.gripped else np.inf
        return memory

    def final_failure(self, memory: TaughtMemory, time: float) -> Failure | None:
        """Return the failure once the time budget is used up."""
        over = time - memory.report.localized_at > self.config.time_budget
        return Failure.TIME_BUDGET if over else None

    def observe_mode(self, memory: TaughtMemory, now: Now) -> Observation:
        """Report whether the arm has arrived, and the grip has lasted."""
        return Observation(
            arrived=memory.motion.arrived(now.senses.q, now.time),
            holding=now.time - memory.gripped_since >= self.config.grip_wait,
        )


class Idle(TaughtMode):
    """Looks until it sees the object, and then plans all motions."""

    mode = Mode.IDLE

    def update(self, memory: TaughtMemory, now: Now) -> TaughtMemory:
        """Look when a look is due, and plan once the grasp point is known."""
        if memory.motions or now.time < memory.next_look:
            return memory
        memory.next_look = now.time + SEARCH_PERIOD
        grasp = self.config.grasp
        p_WT = self._look(memory, now) if grasp is None else np.array(grasp)
        if p_WT is None:
            return memory
        with planning_clock.running():
            planned = self.planner.plan(p_WT)
        memory.ready_at = now.time + self.config.latency
        memory.report = dc.replace(memory.report, localized_at=now.time)
        if isinstance(planned, PlanningFailure):
            memory.report = dc.replace(
                memory.report, failure=planned.failure, message=planned.message
            )
        else:
            memory.motions = planned
        return memory

    def _look(self, memory: TaughtMemory, now: Now) -> Vector | None:
        """Return the tip's position for the grasp (3,) [m]; None if no blob is seen."""
        seen = tuple(now.senses.see())
        report = dc.replace(memory.report, looks=memory.report.looks + 1, blobs=seen)
        memory.report = report
        blob = next((b for b in seen if b.object_name == self.name), None)
        if blob is None:
            return None
        memory.report = dc.replace(
            report, localization=blob, sighting=blob, sighted_at=now.time
        )
        return blob.position

    def observe(self, memory: TaughtMemory, now: Now) -> Observation:
        """Report motions, or why there are none, once the planning latency is over."""
        late = now.time > self.config.search_time
        unseen = Failure.NOT_SEEN if late and not memory.motions else None
        return Observation(
            ready=now.time >= memory.ready_at and bool(memory.motions),
            failure=memory.report.failure or unseen,
        )


class PreGrasp(TaughtMode):
    """Moves the open hand beside the object."""

    mode, commands = Mode.PRE_GRASP, 0.0


class Grasp(TaughtMode):
    """Moves the open hand around the object."""

    mode = Mode.GRASP

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Count the attempt, and move."""
        memory.report = dc.replace(memory.report, attempts=1)
        return super().enter(memory, entry)


class Close(TaughtMode):
    """Closes the fingers until both have sensed something for a while."""

    mode, commands = Mode.CLOSE, 1.0


class Lift(TaughtMode):
    """Moves the arm to the taught posture above."""

    mode = Mode.LIFT


class Place(TaughtMode):
    """Moves the arm to the taught posture at the goal."""

    mode = Mode.PLACE


class Release(TaughtMode):
    """Opens the fingers."""

    mode, commands = Mode.RELEASE, 0.0


class Home(TaughtMode):
    """Moves the arm home, waits there, and closes the hand."""

    mode = Mode.HOME

    @property
    def wait(self) -> float:
        """Time at home, including the time for the fingers to close [s]."""
        return self.config.home_wait + self.config.close_at_home

    def update(self, memory: TaughtMemory, now: Now) -> TaughtMemory:
        """Close the empty hand at the end of the wait."""
        if 0.0 < self.config.close_at_home >= memory.motion.due - now.time:
            memory.closure = 1.0
        return memory


class End(TaughtMode):
    """Holds the arm still: the task is over."""

    def observe(self, memory: TaughtMemory, now: Now) -> Observation:
        """Observe nothing."""
        return Observation()


class Done(End):
    """The arm is home. This planner cannot know whether the object is on its goal."""

    mode = Mode.DONE

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Count the cycle."""
        memory.report = dc.replace(memory.report, cycles=1)
        return super().enter(memory, entry)


class Failed(End):
    """The planner has given up; its status gives the reason."""

    mode = Mode.FAILED

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Record the failure."""
        observed = entry.observation.failure if entry.observation else None
        failure = memory.report.failure or observed
        memory.report = dc.replace(memory.report, failure=failure)
        return super().enter(memory, entry)


_KINDS: tuple[type[TaughtMode], ...] = (
    *(Idle, PreGrasp, Grasp, Close, Lift, Place, Release, Home, Done, Failed),
)


class TaughtPlanner(PlannerMachine[TaughtMemory, Senses]):
    """Looks once and moves through taught waypoints, as the arm's thesis does.

    .. pydrake_system::

        name: TaughtPlanner
        input_ports:
        - blobs
        - arm_state
        - grasped
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Inputs: `blobs` (list[Blob]), evaluated until it contains the named object;
    `arm_state` (2N), [q; v] in rad and rad/s; `grasped` (1), nonzero once both fingers
    sense something. Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0
    open .. 1 closed; `mode` (Mode); `status` (PlannerStatus).

    The blob's position is the grasp point P2. The tip goes from P0 (home) to P1 beside
    it, to P2, up to the taught P3, down to the taught P4 and home, on straight lines
    where the arm can keep to them. The hand closes until both fingers have sensed
    something for `config.grip_wait`, and opens at P4 for `config.release_wait`. There
    is no second look, no correction and no check of the grasp: DONE means that the arm
    is home.

    Args:
        motions: Plans the motions. Its configuration also has the waits, the latency
            and the times to search and to give up.
        object_name: Name of the blob to take.
    """

    def __init__(self, motions: TaughtMotions, object_name: str) -> None:
        super().__init__(
            {kind.mode: kind(motions, object_name) for kind in _KINDS},
            memory=TaughtMemory(Motion(q_rest=motions.q_home)),
            transition=transition,
            config=motions.config,
        )
        self.config = motions.config
        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        self._n = len(motions.q_home)
        self._arm = self.DeclareVectorInputPort(name="arm_state", size=2 * self._n)
        self._grasped = self.DeclareVectorInputPort(name="grasped", size=1)

    def sense(self, context: Context) -> Senses:
        """Return the measurements; the camera is read only while the planner looks."""
        return Senses(
            q=self._arm.Eval(context)[: self._n],
            gripped=bool(self._grasped.Eval(context)[0]),
            see=lambda: self._blobs.Eval(context),
        )
