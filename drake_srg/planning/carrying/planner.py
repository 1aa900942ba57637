"""The planner of two arms that carry an object together: modes, transitions, system."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.carrying.config import CarryMode, CarryTogether
from drake_srg.planning.carrying.motions import (
    CarryTaskPlanner,
    PairGrasp,
    pair_grasp,
)
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    FATAL,
    TRANSITIONS,
    PlannerMemory,
    Senses,
    holding,
)
from drake_srg.planning.pick_and_place.modes import (
    Carrying,
    Entry,
    Now,
    Place,
    task_modes,
)
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.sightings import PickTask, Sightings, View
from drake_srg.planning.pick_and_place.task_motions import Obstacles, TaskMotions
from drake_srg.planning.planner_machine import (
    Observation,
    PlannerMachine,
    Table,
    Transitions,
)
from drake_srg.types import Blob, Mode, Vector

CARRY_TRANSITIONS: Table = {
    **TRANSITIONS,
    Mode.VERIFY: [
        (lambda o, t, c: not o.holding, Mode.RELEASE),
        (lambda o, t, c: t >= max(c.verify_time, c.grip_wait), CarryMode.SETTLE),
    ],
    CarryMode.SETTLE: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        (lambda o, t, c: o.arrived and not o.holding, Mode.RELEASE),
        (lambda o, t, c: o.arrived and o.ready, Mode.LIFT),
    ],
}
carry_transition = Transitions(CARRY_TRANSITIONS, FATAL)


class LargeSightings(Sightings):
    """Finds an object that is larger than the distance between look-alikes.

    In an image, something may cut a part off it. That part is a blob, too, but never a
    certain one.
    """

    def obstacles(self, view: View, p_WO: Vector | None = None) -> Obstacles:
        """Return the other objects; only a certain look-alike is an obstacle."""
        certain = [blob for blob in view.blobs if blob.certain]
        return super().obstacles(View(certain, view.obstacles), p_WO)


class CarryReplanner(Replanner):
    """Plans for both arms, from sightings and the poses of the hands."""

    _task_planner: CarryTaskPlanner

    def regrasp(self, memory: PlannerMemory, q: Vector, time: float) -> None:
        """Plan with the object in both hands, at the pose at which it was seen.

        Args:
            memory: The planner's.
            q: Positions of both arms, shape (2N,) [rad].
            time: Now [s].
        """
        attempt, X_WO = memory.attempt, memory.attempt.X_WO
        assert X_WO is not None, "motions are planned from a sighting"
        grasp = self._task_planner.regrasped(pair_grasp(attempt.planned.grasp), q, X_WO)
        attempt.motions = TaskMotions(grasp, attempt.planned.motions)
        self.carry(memory, time)

    def _in_hand(self, grasp: Grasp, blob: Blob, q: Vector) -> PairGrasp:
        """Return the grasp as it is seen with both arms at `q` (2N,) [rad]."""
        X_WO = self._sightings.pose(blob)
        return self._task_planner.regrasped(pair_grasp(grasp), q, X_WO)


class Settle(Carrying):
    """Moves the set-points to the actual poses of the hands, so that no hand pulls.

    The walls are where the hands met them, not where they were expected. The rest of
    the task is planned from there.
    """

    mode = CarryMode.SETTLE
    config: CarryTogether
    replanner: CarryReplanner

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Move the set-points, and plan the rest."""
        memory = super().enter(memory, entry)
        q_from, q = memory.motion.position(entry.time), entry.senses.q
        settling = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            [0.0, self.config.settle_time],
            np.column_stack([q_from, q]),
            np.zeros(len(q)),
            np.zeros(len(q)),
        )
        # Plan from where the motion ends.
        memory.motion = Motion(q.copy())
        self.replanner.regrasp(memory, q, entry.time)
        memory.motion = Motion(q_from).followed_by(settling, entry.time)
        return memory

    def trajectory(self, memory: PlannerMemory) -> None:
        """Return no planned motion: `enter` makes one."""

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether both hands hold the object, and whether planning is over."""
        return Observation(
            arrived=True,
            holding=holding(memory, now.senses),
            ready=now.time >= memory.attempt.ready_at,
        )


class SetDown(Place):
    """Sets the object down, and waits until the compliant arms rest with it."""

    config: CarryTogether

    @property
    def wait(self) -> float:
        """Time to settle [s]."""
        return self.config.settle_time


class CarryPlanner(PlannerMachine[PlannerMemory, Senses]):
    """Carries an object that is too wide for one hand with two arms.

    .. pydrake_system::

        name: CarryPlanner
        input_ports:
        - blobs
        - FIRST.arm_state
        - FIRST.gripper_state
        - FIRST.grasped
        - FIRST.proximity
        - SECOND.arm_state
        - SECOND.gripper_state
        - SECOND.grasped
        - SECOND.proximity
        output_ports:
        - FIRST.position_commanded
        - FIRST.closure_commanded
        - SECOND.position_commanded
        - SECOND.closure_commanded
        - mode
        - status

    FIRST and SECOND stand for the arms' names. The ports are those of
    `PickAndPlacePlanner`, for each arm.

    Both arms move at once, by one motion of all their joints. Each hand takes an end
    wall of the object from above. Object and arms are then a closed chain: the object
    follows a minimum-jerk motion, and both hands keep their places on it. The modes are
    those of picking and placing, with one more between the check of the grasp and the
    lift: `Settle`.

    Args:
        task_planner: Plans the motions of both arms.
        task: The task; its object has end walls.
        config: Times and limits.
    """

    def __init__(
        self, task_planner: CarryTaskPlanner, task: PickTask, config: CarryTogether
    ) -> None:
        hand = task_planner.hand
        sightings = LargeSightings(task, hand.upright_within)
        replanner = CarryReplanner(task_planner, sightings, config)
        self._names = (config.first, config.second)
        super().__init__(
            task_modes(config, replanner, task.repeat, (Settle, SetDown)),
            memory=PlannerMemory(Motion(q_rest=task_planner.q_home)),
            transition=carry_transition,
            config=config,
            arms=self._names,
            together=True,
        )
        self.task, self.config = task, config
        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        for name in self._names:
            self.declare_hand_inputs(hand.num_joints, hand.num_sensors, f"{name}.")

    def sense(self, context: Context) -> Senses:
        """Return the measurements of both arms, as if they were one."""

        def see() -> View:
            return View(self._blobs.Eval(context))

        hands = [self.hand_senses(context, see, f"{name}.") for name in self._names]
        joined = {
            name: np.concatenate([getattr(hand, name) for hand in hands])
            for name in ("q", "fingers", "finger_speeds", "proximity")
        }
        return Senses(grasped=all(hand.grasped for hand in hands), see=see, **joined)
