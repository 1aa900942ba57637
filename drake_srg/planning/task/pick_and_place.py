"""The state machine that picks an object and places it, as a system."""

import dataclasses as dc
from collections.abc import Mapping

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import (
    BasicVector,
    Context,
    EventStatus,
    State,
)

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.observing import (
    Senses,
    arrived,
    observe,
    watch_grasp,
    watch_touch,
)
from drake_srg.planning.task.planner_memory import PlannerMemory
from drake_srg.planning.task.replanning import Replanner
from drake_srg.planning.task.sightings import Sightings, View
from drake_srg.planning.task.task_motions import TaskPlanner
from drake_srg.planning.task.transitions import Observation, transition
from drake_srg.types import Failure, Mode, PlannerStatus, Shape

_ESCAPE = (Mode.RETREAT, Mode.HOME)
_LOST_IN = {
    Mode.VERIFY: Failure.NO_GRASP,
    Mode.LIFT: Failure.DROPPED,
    Mode.TRANSFER: Failure.DROPPED,
    Mode.PLACE: Failure.DROPPED,
}


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
        - obstacles (optional)
        - external_torque (optional)
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Inputs: `blobs` (list[Blob]), evaluated only when the planner looks; `arm_state`
    (2N) and `gripper_state` (2n), [q; v] in rad and rad/s; `grasped` (1), nonzero once
    both fingers sense something; `proximity` (m), signed distances [m]; `obstacles`
    (list[Obstacle]), evaluated with `blobs`: motions keep clear of them;
    `external_torque` (N) [N m]: beyond `config.max_external_torque` a moving arm stops
    where it is, and the task has failed.

    Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0 open .. 1
    closed; `mode` (Mode); `status` (PlannerStatus).

    The modes follow one another by `transition`, evaluated every `config.period`. The
    planner looks for the object while it is idle, plans all motions at once and moves
    `config.latency` later. A grasp is verified by `grasped` and the fingers' angles
    before the arm lifts, after it has lifted and before it places; where the object
    slips out of the hand on the way, the arm stops. When the object is not in the hand,
    or in the end not seen on its goal, the planner goes home, looks again and repeats,
    `config.max_attempts` times at most; grasps that have failed come last then, and the
    hand closes more firmly.

    With `config.look_before_grasp` it looks once more when the hand is in front of the
    object, and plans anew where that has moved; with `config.look_before_place`, when
    the object is above its goal, and places it from where it is in the hand.

    Args:
        task_planner: Plans the motions.
        object_name: Which blobs to take.
        shape: The object's known shape.
        goal: Where it shall be, X_WO [m]; its turn about its z does not count.
        tolerance: Distance from the goal that counts as placed [m].
        obstacles: Names and shapes of the other objects; motions keep clear of where
            they are seen.
        repeat: How many cycles. Every second one takes the object back, to where it
            was first found.
        config: Times, speeds and limits.

    Raises:
        ValueError: If `config.max_external_torque` has not one entry a joint.
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        object_name: str,
        shape: Shape,
        goal: RigidTransform,
        tolerance: float = 0.005,
        obstacles: Mapping[str, Shape] | None = None,
        repeat: int = 1,
        config: PlannerConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or PlannerConfig()
        hand = task_planner.hand
        limits, n = self.config.max_external_torque, len(task_planner.q_home)
        if limits is not None and len(limits) != n:
            raise ValueError(
                f"planner.max_external_torque: has {len(limits)} entries, "
                f"the arm has {n} joints"
            )
        self._repeat = repeat
        self._replanner = Replanner(
            task_planner,
            Sightings(object_name, shape, obstacles or {}, hand.upright_within),
            goal,
            tolerance,
            self.config,
        )
        self._n, self._n_fingers = n, hand.num_joints

        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        self._arm = self.DeclareVectorInputPort(name="arm_state", size=2 * self._n)
        self._gripper = self.DeclareVectorInputPort(
            name="gripper_state", size=2 * hand.num_joints
        )
        self._grasped = self.DeclareVectorInputPort(name="grasped", size=1)
        self._proximity = self.DeclareVectorInputPort(
            name="proximity", size=hand.num_sensors
        )
        self._obstacles = self.DeclareAbstractInputPort(
            name="obstacles", model_value=AbstractValue.Make([])
        )
        self._external_torque = self.DeclareVectorInputPort(
            name="external_torque", size=self._n
        )
        self._state = self.DeclareAbstractState(
            AbstractValue.Make(PlannerMemory(q_rest=task_planner.q_home))
        )
        state = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort(
            name="position_commanded",
            size=self._n,
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

    def _get(self, context: Context) -> PlannerMemory:
        state: PlannerMemory = context.get_abstract_state(int(self._state)).get_value()
        return state

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._get(context).position(context.get_time()))

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        output[0] = self._get(context).closure

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._get(context).mode)

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._get(context).status())

    # Updates.

    def _initialize(self, context: Context, state: State) -> EventStatus:
        time = context.get_time()
        memory = dc.replace(
            self._get(context), since=time, started=time, next_look=time
        )
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _update(self, context: Context, state: State) -> EventStatus:
        time = context.get_time()
        memory = old = self._get(context)
        senses = self._feel(context)
        memory = watch_touch(memory, senses, self.config)
        memory = watch_grasp(memory, senses, time, self.config)
        look = not memory.looked and arrived(memory, senses, time)
        match memory.mode:
            case Mode.IDLE if time >= memory.next_look:
                memory = self._replanner.plan(self._see(context), memory, time)
            case Mode.PRE_GRASP if look and self.config.look_before_grasp:
                memory = self._replanner.compare(self._see(context), memory, time)
            case Mode.TRANSFER if (
                look and self.config.look_before_place and not memory.lost
            ):
                memory = self._replanner.correct(self._see(context), memory, time)
            case Mode.HOME if 0.0 < self.config.close_at_home >= memory.due - time:
                memory = dc.replace(memory, closure=1.0)
        observation = observe(
            memory,
            senses,
            time,
            self.config,
            lambda: self._replanner.is_at_goal(self._see(context), memory),
            self._repeat,
        )
        mode = transition(memory.mode, observation, time - memory.since, self.config)
        if mode is not memory.mode:
            memory = self._enter(mode, memory, observation, senses, time)
        if memory is not old:
            state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _see(self, context: Context) -> View:
        known = self._obstacles.HasValue(context)
        return View(
            self._blobs.Eval(context), self._obstacles.Eval(context) if known else ()
        )

    def _feel(self, context: Context) -> Senses:
        gripper, n = self._gripper.Eval(context), self._n_fingers
        return Senses(
            q=self._arm.Eval(context)[: self._n],
            fingers=gripper[:n],
            finger_speeds=gripper[n:],
            grasped=bool(self._grasped.Eval(context)[0]),
            proximity=self._proximity.Eval(context),
            external_torque=self._external_torque.Eval(context)
            if self._external_torque.HasValue(context)
            else None,
        )

    def _enter(
        self,
        mode: Mode,
        memory: PlannerMemory,
        o: Observation,
        senses: Senses,
        time: float,
    ) -> PlannerMemory:
        """Begin a mode."""
        if mode in (Mode.IDLE, Mode.FAILED, Mode.DONE):
            return memory.end_attempt(mode, o, time)
        previous, motions = memory.mode, memory.motions
        memory = dc.replace(
            memory,
            mode=mode,
            since=time,
            q_rest=memory.position(time),
            ready_at=time,
            looked=False,
            departed=time,
            stopped_at=None,
        )
        if motions is not None:
            match mode:
                case Mode.PRE_GRASP:
                    memory = dc.replace(
                        memory,
                        closure=motions.grasp.closure_open,
                        fingers=motions.grasp.fingers_open,
                    )
                case Mode.GRASP:
                    memory = dc.replace(memory, attempts=memory.attempts + 1)
                case Mode.CLOSE:
                    memory = dc.replace(memory, closure=motions.grasp.closure_closed)
                case Mode.LIFT:
                    memory = dc.replace(
                        memory, grip=senses.fingers.copy(), unheld_since=np.inf
                    )
                case Mode.RELEASE:
                    memory = dc.replace(memory, closure=motions.grasp.closure_open)
                    if memory.lost or previous is not Mode.PLACE:
                        memory = dc.replace(
                            memory,
                            failure=_LOST_IN[previous],
                            tried=(*memory.tried, motions.grasp.name),
                        )
                        memory = self._replanner.escape(memory, time)
        trajectory = motions.motions.get(mode) if motions is not None else None
        if memory.escape is not None:
            trajectory = dict(zip(_ESCAPE, memory.escape, strict=True)).get(mode)
        due = time + (trajectory.end_time() if trajectory else 0.0)
        if mode in (Mode.LIFT, Mode.TRANSFER):
            due += self.config.verify_time  # a look at the grasp while the arm rests
        if mode is Mode.HOME:
            due += self.config.home_wait + self.config.close_at_home
        return dc.replace(memory, trajectory=trajectory, due=due)
