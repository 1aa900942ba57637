"""The state machine that picks an object and places it, as a system."""

import dataclasses as dc
import time as wall
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    EventStatus,
    State,
)
from pydrake.trajectories import Trajectory

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.config import PlannerConfig
from drake_srg.planning.grasps import EMPTY_BASE_ANGLE, Approach
from drake_srg.planning.task_motions import (
    TaskFailure,
    TaskMotions,
    TaskPlanner,
)
from drake_srg.planning.transitions import Observation, transition
from drake_srg.types import Blob, Failure, Mode, PlannerStatus, Shape, Vector

_STILL = 0.05  # joint speed below which the fingers rest [rad/s]
_CLEAR = 0.001  # distance at which resting fingers have let go of an object [m]
_NEAR = 0.01  # distance within which wrapped fingers have an object [m]
_ARRIVED = 0.005  # joint error within which the arm is where it was sent [rad]
# Duration of a stop in the middle of a motion [s]: at the iiwa's top speed, 1.5 to 2.4
# rad/s, that brakes with less than half of its acceleration limits.
_STOP_TIME = 0.4
_ESCAPE = (Mode.RETREAT, Mode.HOME)
_LOST_IN = {
    Mode.VERIFY: Failure.NO_GRASP,
    Mode.LIFT: Failure.DROPPED,
    Mode.TRANSFER: Failure.DROPPED,
}
_MESSAGES = {
    Failure.STOPPED: "the arm does not get where it is sent; something is in its way",
    Failure.TIME_BUDGET: "the time budget is used up",
    Failure.NO_GRASP: "the fingers closed, but nothing of the right size is in them",
    Failure.DROPPED: "the object was in the hand and got lost",
    Failure.MISPLACED: "the object is not seen on its goal",
}


@dc.dataclass(frozen=True)
class _Memory:
    """The state of the planner. Never changed, only replaced, so copies share it."""

    mode: Mode = Mode.IDLE
    since: float = 0.0  # when the mode began [s]
    started: float = 0.0  # when the task began [s]
    next_look: float = 0.0  # when the object is looked for next [s]
    ready_at: float = np.inf  # when the planned motion may begin [s]
    attempts: int = 0  # grasps begun
    looks: int = 0  # evaluations of `blobs`
    motions: TaskMotions | None = None
    obstacles: tuple[tuple[Shape, Vector], ...] = ()  # other objects seen, p_WO [m]
    escape: tuple[Trajectory, Trajectory] | None = None  # retreat and home
    trajectory: Trajectory | None = None  # of the mode, from `since` on
    due: float = 0.0  # when that motion is over [s]
    stopped_at: float | None = None  # time in the trajectory where a stop began [s]
    q_rest: Vector = dc.field(default_factory=lambda: np.zeros(0))
    closure: float = 0.0
    failure: Failure | None = None  # what went wrong last
    localization: Blob | None = None  # the first one that led to a plan
    localized_at: float = 0.0  # s
    message: str = ""
    planning_wall: float = 0.0  # s

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Memory":
        return self


class PickAndPlacePlanner(LeafSystem):
    """Finds an object, takes it, sets it on its goal and returns home.

    .. pydrake_system::

        name: PickAndPlacePlanner
        input_ports:
        - blobs
        - arm_state
        - gripper_state
        - grasped
        - proximity
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Inputs: `blobs` (list[Blob]), evaluated only when the planner looks; `arm_state`
    (2N) and `gripper_state` (8), [q; v] in rad and rad/s; `grasped` (1), nonzero once
    both fingers sense something; `proximity` (4), signed distances [m].

    Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0 open .. 1
    closed; `mode` (Mode); `status` (PlannerStatus).

    The modes follow one another by `transition`, evaluated every `config.period`. The
    planner looks for the object while it is idle, plans all motions at once and moves
    `config.latency` later. A grasp is verified by `grasped` and the fingers' angles
    before the arm lifts, after it has lifted and before it places. When the object is
    not in the hand, or in the end not seen on its goal, the planner goes home, looks
    again and repeats, `config.max_attempts` times at most.

    Args:
        task_planner: Plans the motions.
        object_name: Which blobs to take.
        shape: The object's known shape.
        goal: Where its centre shall be, p_WO, shape (3,) [m].
        tolerance: Distance from the goal in x and y that counts as placed [m].
        obstacles: Names and shapes of the other objects; where they are seen, upright,
            motions keep clear of them.
        config: Times, speeds and limits.
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        object_name: str,
        shape: Shape,
        goal: Vector,
        tolerance: float = 0.005,
        obstacles: Mapping[str, Shape] | None = None,
        config: PlannerConfig | None = None,
    ) -> None:
        super().__init__()
        self._obstacles = dict(obstacles or {})
        self.config = config or PlannerConfig()
        self._task_planner = task_planner
        self._object_name = object_name
        self._shape = shape
        self._goal = np.asarray(goal, dtype=float)
        self._tolerance = tolerance
        n = len(task_planner.q_home)

        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        self._arm = self.DeclareVectorInputPort(name="arm_state", size=2 * n)
        self._gripper = self.DeclareVectorInputPort(name="gripper_state", size=8)
        self._grasped = self.DeclareVectorInputPort(name="grasped", size=1)
        self._proximity = self.DeclareVectorInputPort(name="proximity", size=4)
        self._state = self.DeclareAbstractState(
            AbstractValue.Make(_Memory(q_rest=task_planner.q_home))
        )
        state = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort(
            name="position_commanded",
            size=n,
            calc=self._calc_position,
            prerequisites_of_calc={*state, self.time_ticket()},
        )
        self.DeclareVectorOutputPort(
            name="closure_commanded",
            size=1,
            calc=self._calc_closure,
            prerequisites_of_calc=state,
        )
        self.DeclareAbstractOutputPort(
            name="mode",
            alloc=lambda: AbstractValue.Make(Mode.IDLE),
            calc=self._calc_mode,
            prerequisites_of_calc=state,
        )
        self.DeclareAbstractOutputPort(
            name="status",
            alloc=lambda: AbstractValue.Make(PlannerStatus()),
            calc=self._calc_status,
            prerequisites_of_calc=state,
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._initialize)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    # Outputs.

    def _memory(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._state)).get_value()
        return memory

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        memory = self._memory(context)
        output.SetFromVector(_position(memory, context.get_time()))

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        output[0] = self._memory(context).closure

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._memory(context).mode)

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        memory = self._memory(context)
        output.set_value(
            PlannerStatus(
                mode=memory.mode,
                failure=memory.failure if memory.mode is Mode.FAILED else None,
                attempts=memory.attempts,
                looks=memory.looks,
                localization=memory.localization,
                localized_at=memory.localized_at,
                message=memory.message,
                planning_wall=memory.planning_wall,
            )
        )

    # Updates.

    def _initialize(self, context: Context, state: State) -> EventStatus:
        time = context.get_time()
        memory = dc.replace(
            self._memory(context), since=time, started=time, next_look=time
        )
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _update(self, context: Context, state: State) -> EventStatus:
        time = context.get_time()
        memory = old = self._memory(context)
        if memory.mode is Mode.IDLE and memory.motions is None:
            memory = self._look(context, memory)
        observation = self._observe(context, memory)
        mode = transition(memory.mode, observation, time - memory.since, self.config)
        if mode is not memory.mode:
            memory = self._enter(mode, memory, observation, time)
        if memory is not old:
            state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _look(self, context: Context, memory: _Memory) -> _Memory:
        """Look for the object and plan, when it is time to."""
        time = context.get_time()
        if time < memory.next_look:
            return memory
        blob = self._best_blob(context)
        memory = dc.replace(memory, looks=memory.looks + 1)
        if blob is None:
            if time < memory.since + self.config.search_time:
                return dc.replace(memory, next_look=time + self.config.search_period)
            # What became of an object that was in the hand says more.
            return dc.replace(
                memory,
                failure=memory.failure or Failure.NOT_SEEN,
                message=memory.message or f"no {self._object_name} in any image",
                next_look=np.inf,
                ready_at=time,
            )
        start = wall.perf_counter()
        obstacles = self._obstacles_seen(context)
        result = self._task_planner.plan(
            memory.q_rest, blob.position, self._shape, self._goal, obstacles
        )
        memory = dc.replace(
            memory,
            planning_wall=memory.planning_wall + wall.perf_counter() - start,
            next_look=np.inf,
            ready_at=time + self.config.latency,
        )
        if isinstance(result, TaskFailure):
            # What became of an object that was in the hand says more.
            if memory.failure is not None:
                return memory
            return dc.replace(memory, failure=result.failure, message=result.message)
        if memory.localization is None:
            memory = dc.replace(memory, localization=blob, localized_at=time)
        return dc.replace(memory, motions=result, obstacles=obstacles, failure=None)

    def _obstacles_seen(self, context: Context) -> tuple[tuple[Shape, Vector], ...]:
        blobs: list[Blob] = self._blobs.Eval(context)
        return tuple(
            (self._obstacles[blob.object_name], blob.position)
            for blob in blobs
            if blob.object_name in self._obstacles
        )

    def _best_blob(self, context: Context) -> Blob | None:
        blobs: list[Blob] = self._blobs.Eval(context)
        blobs = [blob for blob in blobs if blob.object_name == self._object_name]
        return max(blobs, key=lambda b: (not b.flags, b.quality), default=None)

    def _observe(self, context: Context, memory: _Memory) -> Observation:
        """Evaluate what the mode's transitions need, and only that."""
        time, mode = context.get_time(), memory.mode
        if time - memory.started > self.config.time_budget:
            return Observation(failure=Failure.TIME_BUDGET)
        if mode is Mode.IDLE:
            due = time >= memory.ready_at
            planned = memory.motions is not None
            return Observation(
                ready=due and planned,
                failure=memory.failure if due and not planned else None,
            )
        if mode in (Mode.CLOSE, Mode.VERIFY, Mode.RELEASE):
            speeds = self._gripper.Eval(context)[4:]
            return Observation(
                still=bool(np.max(np.abs(speeds)) < _STILL),
                holding=self._holding(context, memory),
                clear=time >= memory.ready_at
                and bool(np.min(self._proximity.Eval(context)) > _CLEAR),
            )
        arrived = self._arrived(context, memory)
        if not arrived and time > memory.due + self.config.arrival_timeout:
            return Observation(failure=Failure.STOPPED)
        if mode is not Mode.HOME or not arrived:
            return Observation(
                arrived=arrived, holding=arrived and self._holding(context, memory)
            )
        if memory.failure is None:
            blob = self._best_blob(context)
            at_goal = blob is not None and bool(
                np.linalg.norm((blob.position - self._goal)[:2]) <= self._tolerance
            )
        else:
            at_goal = False
        out_of_attempts = memory.attempts >= self.config.max_attempts
        return Observation(
            arrived=True,
            at_goal=at_goal,
            failure=(memory.failure or Failure.MISPLACED) if out_of_attempts else None,
        )

    def _arrived(self, context: Context, memory: _Memory) -> bool:
        if memory.trajectory is None:
            return True
        if context.get_time() < memory.due:
            return False
        q = self._arm.Eval(context)[: len(memory.q_rest)]
        goal = memory.trajectory.value(memory.trajectory.end_time())[:, 0]
        return bool(np.max(np.abs(q - goal)) < _ARRIVED)

    def _holding(self, context: Context, memory: _Memory) -> bool:
        """Whether both fingers sense something, and not just one another."""
        if memory.motions is None or self._grasped.Eval(context)[0] == 0.0:
            return False
        grasp = memory.motions.grasp
        if grasp.approach is Approach.SIDE:
            # What fingers wrap around is beside their base links, which do not sense
            # each other.
            return bool(np.max(self._proximity.Eval(context)[:2]) < _NEAR)
        # Half way between the angle at contact and that of an empty hand.
        limit = 0.5 * (grasp.base_angle + EMPTY_BASE_ANGLE)
        return bool(np.max(self._gripper.Eval(context)[:2]) < limit)

    def _enter(
        self, mode: Mode, memory: _Memory, o: Observation, time: float
    ) -> _Memory:
        """Begin a mode."""
        if mode in (Mode.IDLE, Mode.FAILED, Mode.DONE):
            return _end_attempt(memory, mode, o, time)
        previous, motions = memory.mode, memory.motions
        assert motions is not None  # these modes follow a plan
        memory = dc.replace(
            memory, mode=mode, since=time, q_rest=_position(memory, time), ready_at=time
        )
        match mode:
            case Mode.PRE_GRASP:
                memory = dc.replace(
                    memory,
                    attempts=memory.attempts + 1,
                    closure=motions.grasp.closure_open,
                )
            case Mode.CLOSE:
                memory = dc.replace(memory, closure=motions.grasp.closure_closed)
            case Mode.RELEASE:
                memory = dc.replace(
                    memory,
                    closure=motions.grasp.closure_open,
                    failure=_LOST_IN.get(previous),
                )
                if memory.failure is not None:
                    memory = self._plan_escape(memory)
        trajectory = motions.motions.get(mode)
        if memory.escape is not None:
            trajectory = dict(zip(_ESCAPE, memory.escape, strict=True)).get(mode)
        due = time + (trajectory.end_time() if trajectory else 0.0)
        if mode in (Mode.LIFT, Mode.TRANSFER):
            due += self.config.verify_time  # a look at the grasp while the arm rests
        return dc.replace(memory, trajectory=trajectory, due=due)

    def _plan_escape(self, memory: _Memory) -> _Memory:
        start = wall.perf_counter()
        escape = self._task_planner.plan_escape(memory.q_rest, memory.obstacles)
        memory = dc.replace(
            memory,
            planning_wall=memory.planning_wall + wall.perf_counter() - start,
            ready_at=memory.since + self.config.latency,
        )
        if isinstance(escape, TaskFailure):
            return dc.replace(memory, mode=Mode.FAILED, message=escape.message)
        return dc.replace(memory, escape=escape)


def _end_attempt(memory: _Memory, mode: Mode, o: Observation, time: float) -> _Memory:
    """Forget the motions, but not what went wrong."""
    previous = memory.mode
    failure = o.failure or memory.failure
    if previous is Mode.HOME and memory.failure is None:
        memory = dc.replace(memory, looks=memory.looks + 1)  # for `at_goal`
        if mode is not Mode.DONE:
            failure = Failure.MISPLACED
    if failure is not None and previous is not Mode.IDLE:
        memory = dc.replace(memory, message=_MESSAGES.get(failure, memory.message))
    moving = memory.trajectory is not None and time < memory.due
    return dc.replace(
        memory,
        mode=mode,
        since=time,
        q_rest=_position(memory, time),
        # A motion that is under way comes to rest along its own path.
        trajectory=memory.trajectory if moving else None,
        stopped_at=time - memory.since if moving else None,
        failure=failure,
        motions=None,
        escape=None,
        next_look=time,
        ready_at=np.inf,
    )


def _position(memory: _Memory, time: float) -> Vector:
    """The commanded position at a time, shape (N,) [rad]."""
    if memory.trajectory is None:
        return memory.q_rest
    t = time - memory.since
    if memory.stopped_at is not None:
        t = min(t, _STOP_TIME)
        t = memory.stopped_at + t - 0.5 * t * t / _STOP_TIME
    q: Vector = memory.trajectory.value(min(t, memory.trajectory.end_time()))[:, 0]
    return q
