"""The state machine that picks an object and places it, as a system."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    PlannerMemory,
    Senses,
    transition,
)
from drake_srg.planning.pick_and_place.modes import TaskMode, task_modes
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.sightings import PickTask, Sightings, View
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.planning.planner_machine import (
    Observation,
    PlannerConfig,
    PlannerMachine,
)
from drake_srg.types import AnyMode

MakeModes: TypeAlias = Callable[
    [PlannerConfig, Replanner, int], Mapping[AnyMode, TaskMode]
]
Transition: TypeAlias = Callable[[AnyMode, Observation, float, PlannerConfig], AnyMode]


class PickAndPlacePlanner(PlannerMachine[PlannerMemory, Senses]):
    """Finds an object, picks it up, places it on its goal and returns home.

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
    (list[Obstacle]), evaluated with `blobs`, from which motions keep clear;
    `external_torque` (N) [N m]: if it exceeds `config.max_external_torque`, a moving
    arm stops at once, and the task fails.

    Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0 open .. 1
    closed; `mode` (AnyMode); `status` (PlannerStatus).

    The modes follow one another by `transition`, evaluated every `config.period`. While
    idle, the planner looks for the object. It plans all motions at once and moves
    `config.latency` later. `grasped` and the fingers' angles verify the grasp before
    the arm lifts, after it has lifted and before it places. If the object slips out of
    the hand on the way, the arm stops. If the object is not in the hand, or not seen on
    its goal in the end, the planner goes home, looks again and tries again, at most
    `config.max_attempts` times. It then prefers grasps that have not failed yet, and
    closes the hand more firmly.

    With `config.look_before_grasp`, the planner looks again when the hand is in front
    of the object, and plans again if the object has moved. With
    `config.look_before_place`, it looks when the object is above its goal, and corrects
    its placing by the object's pose in the hand.

    `task` and `config` can be read from the system.

    Args:
        task_planner: Plans the motions.
        task: The object to take, and its goal.
        config: Times, speeds and limits.
        make_modes: Makes the actions of each mode. Add your own modes to those of
            `task_modes`.
        transition: Returns the mode that follows; with your own modes, `Transitions` of
            a table made from `TRANSITIONS`.
        make_memory: Class of the memory. Derive it if your own modes need more.

    Raises:
        ValueError: If `config.max_external_torque` lacks one entry per joint, or the
            transitions lead to a mode without actions.
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        task: PickTask,
        config: PlannerConfig | None = None,
        *,
        make_modes: MakeModes = task_modes,
        transition: Transition = transition,
        make_memory: type[PlannerMemory] = PlannerMemory,
    ) -> None:
        config = config or PlannerConfig()
        hand, n = task_planner.hand, len(task_planner.q_home)
        limits = config.max_external_torque
        if limits is not None and len(limits) != n:
            raise ValueError(
                "planner.max_external_torque: needs one entry per joint of the arm "
                f"({n}), got {len(limits)}"
            )
        sightings = Sightings(task, hand.upright_within)
        replanner = Replanner(task_planner, sightings, config)
        super().__init__(
            make_modes(config, replanner, task.repeat),
            memory=make_memory(Motion(q_rest=task_planner.q_home)),
            transition=transition,
            config=config,
        )
        self.task, self.config = task, config
        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        self.declare_hand_inputs(hand.num_joints, hand.num_sensors)
        self._obstacles = self.DeclareAbstractInputPort(
            name="obstacles", model_value=AbstractValue.Make([])
        )
        self._external_torque = self.DeclareVectorInputPort(
            name="external_torque", size=n
        )

    def sense(self, context: Context) -> Senses:
        """Return the measurements; the cameras are read only when a mode looks."""
        torque = self._external_torque
        return Senses(
            **vars(self.hand_senses(context, lambda: self._see(context))),
            external_torque=torque.Eval(context) if torque.HasValue(context) else None,
        )

    def _see(self, context: Context) -> View:
        known = self._obstacles.HasValue(context)
        return View(
            self._blobs.Eval(context), self._obstacles.Eval(context) if known else ()
        )
