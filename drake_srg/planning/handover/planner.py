"""The planner that hands an object over: its transitions and its system."""

from __future__ import annotations

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from drake_srg.planning.handover.config import (
    Handover,
    HandoverMemory,
    HandoverMode,
    HandoverSenses,
    Side,
)
from drake_srg.planning.handover.modes import (
    GIVERS,
    RECEIVERS,
    HandoverReplanner,
    memory_of,
)
from drake_srg.planning.handover.motions import HandoverTaskPlanner
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    FATAL,
    TRANSITIONS,
    PlannerMemory,
    Senses,
    carried,
)
from drake_srg.planning.pick_and_place.modes import task_modes
from drake_srg.planning.pick_and_place.sightings import PickTask, Sightings, View
from drake_srg.planning.planner_machine import PlannerMachine, Table, Transitions
from drake_srg.types import Mode

HANDOVER_TRANSITIONS: Table = {
    **TRANSITIONS,
    # The giver.
    Mode.IDLE: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        (lambda o, t, c: o.ready, Mode.PRE_GRASP),
        (lambda o, t, c: o.stuck, HandoverMode.WITHDRAW),
    ],
    Mode.VERIFY: [
        (lambda o, t, c: not o.holding, HandoverMode.LET_GO),
        (lambda o, t, c: t >= max(c.verify_time, c.grip_wait), Mode.LIFT),
    ],
    Mode.LIFT: carried(HandoverMode.CARRY, HandoverMode.LET_GO),
    HandoverMode.CARRY: carried(HandoverMode.PRESENT, HandoverMode.LET_GO),
    HandoverMode.PRESENT: carried(HandoverMode.APPROACH, HandoverMode.LET_GO),
    # The receiver.
    HandoverMode.APPROACH: carried(HandoverMode.REACH),
    HandoverMode.REACH: carried(HandoverMode.TAKE),
    HandoverMode.TAKE: [
        (
            lambda o, t, c: (
                o.holding
                and t >= max(c.gripper_reaction, c.grip_wait)
                and (o.still or t >= c.gripper_timeout)
            ),
            HandoverMode.PULL,
        ),
        (lambda o, t, c: t >= c.gripper_timeout and not o.holding, Mode.RELEASE),
    ],
    HandoverMode.PULL: [
        (lambda o, t, c: o.arrived and o.ready, HandoverMode.LET_GO),
        (lambda o, t, c: o.arrived, Mode.RELEASE),
    ],
    # The giver.
    HandoverMode.LET_GO: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        (
            lambda o, t, c: t >= c.release_wait and o.clear and o.still,
            HandoverMode.WITHDRAW,
        ),
        (
            lambda o, t, c: t >= c.gripper_timeout + c.release_wait,
            HandoverMode.WITHDRAW,
        ),
    ],
    HandoverMode.WITHDRAW: [(lambda o, t, c: o.arrived, HandoverMode.CLEAR)],
    HandoverMode.CLEAR: [
        (lambda o, t, c: o.arrived and o.ready, HandoverMode.SECURE),
        *TRANSITIONS[Mode.HOME],
    ],
    # The receiver, which then continues as in picking and placing.
    HandoverMode.SECURE: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        *carried(HandoverMode.RAISE),
    ],
    HandoverMode.RAISE: carried(Mode.TRANSFER),
    Mode.HOME: [
        (lambda o, t, c: o.arrived and o.stuck, HandoverMode.LET_GO),
        (lambda o, t, c: o.arrived and o.moved, HandoverMode.APPROACH),
        *TRANSITIONS[Mode.HOME],
    ],
}
handover_transition = Transitions(HANDOVER_TRANSITIONS, FATAL)


class HandoverPlanner(PlannerMachine[PlannerMemory, Senses]):
    """Picks an object with one arm, hands it to another, and places it with that one.

    .. pydrake_system::

        name: HandoverPlanner
        input_ports:
        - blobs
        - GIVER.arm_state
        - GIVER.gripper_state
        - GIVER.grasped
        - GIVER.proximity
        - GIVER.external_torque
        - RECEIVER.arm_state
        - RECEIVER.gripper_state
        - RECEIVER.grasped
        - RECEIVER.proximity
        - RECEIVER.external_torque
        output_ports:
        - GIVER.position_commanded
        - GIVER.closure_commanded
        - RECEIVER.position_commanded
        - RECEIVER.closure_commanded
        - mode
        - status

    GIVER and RECEIVER stand for the arms' names. The ports are those of
    `PickAndPlacePlanner`, for each arm.

    One arm moves at a time, and its motions keep clear of the other one. The giver
    takes the object by its upper end, lifts it and presents it in the air. The receiver
    takes its lower end from the side, and pulls. Once the giver feels the pull at its
    joints, it lets go, draws back and goes home. Then the receiver sets the object down
    on the goal. All motions are planned before the first one, so that an object that
    cannot be handed over stays where it is.

    Args:
        task_planner: Plans the motions of both arms.
        task: The task; its object is a cylinder.
        config: Times, forces and limits.
    """

    def __init__(
        self, task_planner: HandoverTaskPlanner, task: PickTask, config: Handover
    ) -> None:
        hand = task_planner.hand
        sightings = Sightings(task, hand.upright_within)
        replanners = [
            HandoverReplanner(task_planner, sightings, config, receiver=second)
            for second in (False, True)
        ]
        memory = HandoverMemory(
            Motion(q_rest=task_planner.q_home),
            other=Side(Motion(q_rest=task_planner.receiver.q_home)),
            arms=(config.giver, config.receiver),
        )
        super().__init__(
            {
                **task_modes(config, replanners[0], task.repeat, GIVERS),
                **{k.mode: k(config, replanners[1], task.repeat) for k in RECEIVERS},
            },
            memory=memory,
            transition=handover_transition,
            config=config,
            arms=memory.arms,
        )
        self._names = {False: config.giver, True: config.receiver}
        self.task, self.config = task, config
        self._blobs = self.DeclareAbstractInputPort(
            name="blobs", model_value=AbstractValue.Make([])
        )
        n = len(task_planner.q_home)
        for name in self._names.values():
            self.declare_hand_inputs(hand.num_joints, hand.num_sensors, f"{name}.")
            self.DeclareVectorInputPort(name=f"{name}.external_torque", size=n)

    def commands(self, memory: PlannerMemory, arm: str) -> tuple[Motion, float]:
        """Return the motion and the commanded closure of an arm, by its name."""
        return memory_of(memory).commands(arm)

    def sense(self, context: Context) -> Senses:
        """Return the measurements of both arms, first of the active one."""
        receiving = memory_of(self.state(context).memory).receiving
        first, second = (
            self._senses(context, self._names[receiver])
            for receiver in (receiving, not receiving)
        )
        return HandoverSenses(**vars(first), other=second)

    def _senses(self, context: Context, name: str) -> Senses:
        prefix = f"{name}."
        torque = self.GetInputPort(f"{prefix}external_torque")
        own = self.hand_senses(context, lambda: View(self._blobs.Eval(context)), prefix)
        return Senses(**vars(own), external_torque=torque.Eval(context))
