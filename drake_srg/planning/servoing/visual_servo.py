"""Visual servos: their loop, on an object's pose or on points in the image."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, EventStatus, State

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.servoing.config import (
    ServoCommand,
    ServoConfig,
    ServoFault,
    ServoState,
    ServoStatus,
)
from drake_srg.planning.servoing.hand_motion import (
    ServoArm,
    behind,
    hand_twist,
    image_displacement,
    limited,
)
from drake_srg.planning.servoing.memory import Memory
from drake_srg.planning.servoing.tracker import (
    Capture,
    FeatureSighting,
    PoseSighting,
    Sighting,
)
from drake_srg.types import Vector

_UP = np.array([0.0, 0.0, 1.0])
_PASS = ServoCommand.PASS
_ROUNDING = 1e-9  # of the times of updates, which are multiples of the period [s]
# The hand may turn at 1 rad/s if it may move at 0.25 m/s [rad/m]. It turns only to keep
# its orientation.
_TURNING = 4.0
# Singular value of the interaction matrix, for image coordinates at focal length 1,
# below which a direction counts as lost.
_LEAST_INTERACTION = 0.2
# Distance from the line of approach at which the hand is aligned [m]: more than the
# default `tolerance`, so that the way to the goal is free before it is reached.
_ALIGNED = 0.004
# Speed at which the hand raises the grasped object [m/s]: slow enough to brake within
# millimetres.
RISE_SPEED = 0.1
# Singular value of the arm's Jacobian below which a direction is damped.
_LEAST_JACOBIAN = 0.05


class VisualServo(LeafSystem):
    """Drives a hand by images of its own camera; base class of the servos.

    It stands between the planner of the arm's motion and the arm's driver (or the
    safety monitor before it). The hand keeps the orientation in which the servo began.
    Derive from it and override `goal_camera`.

    .. pydrake_system::

        name: VisualServo
        input_ports:
        - command
        - position_planned
        - arm_state
        - sighting
        output_ports:
        - position_commanded
        - status

    Inputs: `command` (ServoCommand); `position_planned` (N) [rad]; `arm_state` (2N),
    [q; v] in rad and rad/s; `sighting`, the content of the camera's image, evaluated
    only while the servo tracks, every `config.camera_period`. A sighting that was
    `taken` earlier is used once, with the arm's positions at that time; the servo looks
    for the next one every `config.period`. Outputs: `position_commanded` (N) [rad];
    `status` (ServoStatus).

    With PASS, `position_planned` passes at once and unchanged if the servo rests.
    Otherwise, its commands first move there without a jump. With TRACK, every image
    gives the hand's goal in world. An alpha-beta filter estimates the goal and its
    velocity, and every `config.period` the hand moves towards the goal's present
    position. With FOLLOW, images are ignored, and the hand continues with the goal's
    last velocity. With RAISE, it also rises by `config.rise`, and then brakes and
    rests. With HOLD, it brakes and rests at once.

    The hand is held while the object is not wholly in the image or the features do not
    determine the motion. After `config.patience` such images, or as many equal images
    of a moving hand, or as long without a new image or without motion of the arm, the
    servo fails: it brakes, holds, and reports why, until the command is PASS.

    Args:
        arm: Kinematics of arm and hand.
        X_GC: Assumed pose of the camera in the hand [m].
        axis_G: Direction of approach in the hand, a unit vector, shape (3,).
        goal: The camera's sighting with the hand at its goal.
        config: Gains and limits.
    """

    def __init__(
        self,
        arm: ServoArm,
        X_GC: RigidTransform,
        axis_G: Vector,
        goal: Sighting,
        config: ServoConfig | None = None,
    ) -> None:
        super().__init__()
        config = config or ServoConfig()
        self._arm, self._X_GC = arm, X_GC
        self._axis_G = np.asarray(axis_G, dtype=float)
        self.goal: Any = goal
        self.config = config
        self._command = self.DeclareAbstractInputPort(
            name="command", model_value=AbstractValue.Make(ServoCommand.PASS)
        )
        self._planned = self.DeclareVectorInputPort("position_planned", arm.num_joints)
        self._measured = self.DeclareVectorInputPort("arm_state", 2 * arm.num_joints)
        self._sighting = self.DeclareAbstractInputPort(
            name="sighting", model_value=AbstractValue.Make(type(goal)())
        )
        self._state = self.DeclareAbstractState(AbstractValue.Make(Memory()))
        ticket = self.abstract_state_ticket(self._state)
        self.DeclareVectorOutputPort(
            name="position_commanded",
            size=arm.num_joints,
            calc=self._calc_position,
            prerequisites_of_calc={
                ticket,
                self._command.ticket(),
                self._planned.ticket(),
            },
        )
        self.DeclareAbstractOutputPort(
            name="status",
            alloc=lambda: AbstractValue.Make(ServoStatus()),
            calc=self._calc_status,
            prerequisites_of_calc={ticket},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(config.period, 0.0, self._update)

    def goal_camera(self, sighting: Any) -> Vector | ServoFault:
        """Return where the camera must go, in its present frame, shape (3,) [m].

        Args:
            sighting: Sighting in the camera's image.

        Returns:
            The position, or the reason why the image does not determine it.
        """
        raise NotImplementedError

    def _memory(self, context: Context) -> Memory:
        memory: Memory = context.get_abstract_state(int(self._state)).get_value()
        return memory

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        memory = self._memory(context)
        rests = memory.status.at_rest and self._command.Eval(context) is _PASS
        passing = rests or memory.status.state is ServoState.PASSING
        q = self._passed(context, memory) if passing else memory.status.q
        output.SetFromVector(q)

    def _passed(self, context: Context, memory: Memory) -> Vector:
        """Return the commands of a servo that passes on a plan, shape (N,) [rad]."""
        planned: Vector = self._planned.Eval(context)
        over = memory.hand_over
        return planned if over is None else planned + over.offset

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._memory(context).status)

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, time = self._memory(context), context.get_time()
        command: ServoCommand = self._command.Eval(context)
        if command is _PASS:
            passing = memory.passing(self._planned.Eval(context), self.config)
            if passing is memory:
                return EventStatus.DidNothing()
            memory = passing
        else:
            if memory.status.state is ServoState.PASSING:
                q = self._passed(context, memory).copy()
                memory = Memory.begun(q, self._arm.X_WG(q).rotation(), time)
            if memory.status.state is not ServoState.FAILED:
                if command is ServoCommand.HOLD:
                    memory = memory.holding(time)
                elif command is ServoCommand.FOLLOW:
                    memory = memory.following()
                elif command is ServoCommand.RAISE:
                    height = self._arm.X_WG(memory.status.q).translation()[2]
                    memory = memory.raising(float(height), self.config)
                elif time > memory.next_look - _ROUNDING:
                    memory = self._looked(context, memory, time)
            memory = self._moved(memory, time)
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _looked(self, context: Context, memory: Memory, time: float) -> Memory:
        """Return the memory after a look, with or without a new image."""
        config = self.config
        q = self._measured.Eval(context)[: self._arm.num_joints]
        if config.looks and memory.status.images >= config.looks:
            memory = dc.replace(memory, next_look=time + config.camera_period)
            return memory.near(self._arm.X_WG(q).translation(), time, config)
        sighting: Sighting = self._sighting.Eval(context)
        taken = sighting.taken or Capture(time, q)
        if taken.time <= memory.taken:
            return memory.waited(time, config)
        next_look = time + config.camera_period if sighting.taken is None else time
        memory = dc.replace(memory, next_look=next_look, taken=taken.time, heard=time)
        X_WG = self._arm.X_WG(taken.q)
        memory, frozen = memory.compared(sighting.frame, X_WG.translation(), config)
        if frozen:
            return memory.missed_one(ServoFault.FROZEN, config)
        p_CC_goal = self.goal_camera(sighting)
        if isinstance(p_CC_goal, ServoFault):
            return memory.missed_one(p_CC_goal, config)
        X_CC_goal = RigidTransform(p_CC_goal)
        X_WG_goal = X_WG @ self._X_GC @ X_CC_goal @ self._X_GC.inverse()
        p_goal = X_WG_goal.translation()
        return memory.seen(X_WG.translation(), p_goal, taken.time, config)

    def _moved(self, memory: Memory, time: float) -> Memory:
        """Return the memory after a step of the arm."""
        config = self.config
        most = config.acceleration * config.period
        step = self._wanted(memory, time) - memory.twist
        twist = memory.twist + np.concatenate(
            [limited(step[:3], most), limited(step[3:], _TURNING * most)]
        )
        made = self._arm.step(memory.status.q, twist, config.period, _LEAST_JACOBIAN)
        return memory.stepped(made, twist, config)

    def _wanted(self, memory: Memory, time: float) -> Vector:
        """Return the hand's desired twist, shape (6,)."""
        config, goal = self.config, memory.goal
        held = memory.status.state in (ServoState.HOLDING, ServoState.FAILED)
        if goal is None or held or memory.status.fault is not None:
            return np.zeros(6)
        X_WG = self._arm.X_WG(memory.status.q)
        axis_W = X_WG.rotation() @ self._axis_G
        p_goal = goal.at(time + config.lag)
        back = behind(
            p_goal - X_WG.translation(),
            axis_W,
            standoff=config.standoff,
            alignment=_ALIGNED,
            funnel=config.funnel,
        )
        twist = hand_twist(
            X_WG,
            RigidTransform(memory.R_WG_goal, p_goal - back * axis_W),
            gain=config.gain,
            speed=config.speed,
            turning=_TURNING * config.speed,
        )
        if memory.status.state is ServoState.RAISING:
            twist[:3] = RISE_SPEED * _UP
        twist[:3] += goal.v_W
        return twist


class PositionBasedServo(VisualServo):
    """Drives the hand until the camera sees an object in a given pose.

    .. pydrake_system::

        name: PositionBasedServo
        input_ports:
        - command
        - position_planned
        - arm_state
        - sighting
        output_ports:
        - position_commanded
        - status

    The ports are those of `VisualServo`; `sighting` is a PoseSighting. The error is the
    object's position in the camera relative to that of the goal.

    Args: as of `VisualServo`; the goal is a PoseSighting.
    """

    def goal_camera(self, sighting: PoseSighting) -> Vector | ServoFault:
        """Return the camera's goal in its present frame; see `VisualServo`."""
        if sighting.X_CO is None:
            return ServoFault.LOST
        p_CO: Vector = sighting.X_CO.translation()
        return p_CO - self.goal.X_CO.translation()


class ImageBasedServo(VisualServo):
    """Drives the hand until image points are at their goals.

    .. pydrake_system::

        name: ImageBasedServo
        input_ports:
        - command
        - position_planned
        - arm_state
        - sighting
        output_ports:
        - position_commanded
        - status

    The ports are those of `VisualServo`; `sighting` is a FeatureSighting with as many
    points as `goal`. The error of the points in the image goes through the damped
    inverse of their interaction matrix (see `image_displacement`). If the matrix is
    nearly singular, the hand is held.

    Args: as of `VisualServo`; the goal is a FeatureSighting. Only the orientation of
        the camera's assumed pose matters.
    """

    def goal_camera(self, sighting: FeatureSighting) -> Vector | ServoFault:
        """Return the camera's goal in its present frame; see `VisualServo`."""
        if not len(sighting.points):
            return ServoFault.LOST
        found = image_displacement(
            sighting.points,
            sighting.depths,
            self.goal.points,
            self.goal.depths,
            _LEAST_INTERACTION,
        )
        return found.x if found.least >= _LEAST_INTERACTION else ServoFault.SINGULAR
