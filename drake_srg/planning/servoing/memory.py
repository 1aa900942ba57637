"""The memory of a visual servo, with the goal's filter and the return to positions."""

from __future__ import annotations

import dataclasses as dc
import math
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix

from drake_srg.common.shared import Shared
from drake_srg.planning.servoing.config import (
    ServoConfig,
    ServoFault,
    ServoState,
    ServoStatus,
)
from drake_srg.planning.servoing.hand_motion import JointStep
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class MovingGoal:
    """Position and velocity of a goal. It is replaced, never changed."""

    p_W: Vector  # at `time`, shape (3,) [m]
    v_W: Vector = dc.field(default_factory=lambda: np.zeros(3))  # shape (3,) [m/s]
    time: float = 0.0  # s

    def at(self, time: float) -> Vector:
        """Return the goal's position at a time, shape (3,) [m]."""
        return self.p_W + (time - self.time) * self.v_W

    def seen(self, p_W: Vector, time: float, alpha: float, beta: float) -> MovingGoal:
        """Return the goal, updated by a sighting.

        Args:
            p_W: Seen position of the goal, shape (3,) [m].
            time: Time of the sighting, later than that of the previous one [s].
            alpha: Gain on the innovation, for the position.
            beta: Gain on the innovation, for the velocity.
        """
        surprise = p_W - self.at(time)
        elapsed = time - self.time
        return MovingGoal(
            self.at(time) + alpha * surprise,
            self.v_W + beta / elapsed * surprise,
            time,
        )


# Gains of the alpha-beta filter, which correct the goal's position and velocity by the
# innovation of a sighting. They are near critical damping, beta = 2 - alpha - 2 sqrt(1
# - alpha).
_ALPHA, _BETA = 0.6, 0.135
_DECAY = 6.0  # 1/s; a hand at 0.25 m/s brakes with less than half the arm's limits
_GONE = 1e-6  # rad, rad/s


@dc.dataclass(frozen=True)
class HandOver:
    """A deviation from planned positions that fades away, critically damped.

    Attributes:
        offset: Offset of the commands from the planned positions, shape (N,) [rad].
        rate: Its velocity, shape (N,) [rad/s].
    """

    offset: Vector
    rate: Vector

    def stepped(self, period: float) -> HandOver | None:
        """Return the deviation a period [s] later; None once it is gone."""
        left = math.exp(-_DECAY * period)
        slope = self.rate + _DECAY * self.offset
        offset = left * (self.offset + period * slope)
        rate = left * (self.rate - _DECAY * period * slope)
        gone = max(np.max(np.abs(offset)), np.max(np.abs(rate))) < _GONE
        return None if gone else HandOver(offset, rate)


# A step with less than this share of the hand's motion counts as no step, unless the
# motion is slower than this [m/s].
_NO_STEP, _SLOW = 0.1, 0.005
# A rising hand brakes this far below its top [m]. It stops up to 3 mm higher than that.
_THERE = 1e-3


@dc.dataclass(frozen=True)
class Memory(Shared):
    """A servo's memory.

    Attributes:
        status: Status that the servo reports.
        goal: The hand's goal; None before the first sighting.
        R_WG_goal: The orientation that the hand keeps.
        twist: Twist of the hand, [v; w] in world, shape (6,) [m/s], [rad/s].
        next_look: Time of the next image [s].
        taken: Time at which the latest image was taken [s].
        heard: Time at which it arrived; before the first image, the servo's start [s].
        frame: Frame of the latest image; None before the first one.
        p_frame: Position of the hand when that image was new, shape (3,) [m].
        same: Number of later images that are equal to it.
        missed: Images in a row without a usable sighting.
        near_goal: Images in a row with the hand at its goal.
        near_since: Time at which the first of them arrived [s].
        top: Height at which a rising hand stops [m]; None before it rises.
        stuck: Steps in a row in which the arm did not move the hand.
        v: Velocity of the commands, shape (N,) [rad/s].
        hand_over: While the servo passes, its remaining deviation from the plan.
    """

    status: ServoStatus = dc.field(default_factory=ServoStatus)
    goal: MovingGoal | None = None
    R_WG_goal: RotationMatrix = dc.field(default_factory=RotationMatrix)
    twist: Vector = dc.field(default_factory=lambda: np.zeros(6))
    next_look: float = 0.0
    taken: float = -np.inf
    heard: float = 0.0
    frame: int | None = None
    p_frame: Vector = dc.field(default_factory=lambda: np.zeros(3))
    same: int = 0
    missed: int = 0
    near_goal: int = 0
    near_since: float = 0.0
    top: float | None = None
    stuck: int = 0
    v: Vector = dc.field(default_factory=lambda: np.zeros(0))
    hand_over: HandOver | None = None

    @classmethod
    def begun(cls, q: Vector, R_WG: RotationMatrix, time: float) -> Memory:
        """Return the memory of a servo that begins with the arm at `q` (N,) [rad]."""
        status = ServoStatus(ServoState.TRACKING, q=q)
        return cls(status, R_WG_goal=R_WG, next_look=time, heard=time)

    def passing(self, planned: Vector, config: ServoConfig) -> Memory:
        """Return the memory of a servo that passes on planned positions (N,) [rad]."""
        hand_over = self.hand_over
        if self.status.state is not ServoState.PASSING and not self.status.at_rest:
            hand_over = HandOver(self.status.q - planned, self.v)
        elif self.status.state is ServoState.PASSING and hand_over is None:
            return self
        if hand_over is not None:
            hand_over = hand_over.stepped(config.period)
        return Memory(hand_over=hand_over)

    def holding(self, time: float) -> Memory:
        """Return the memory of a servo that brakes and holds the hand."""
        memory = self._reporting(state=ServoState.HOLDING, fault=None)
        return dc.replace(memory, heard=time)

    def following(self) -> Memory:
        """Return the memory of a servo that no longer needs images."""
        return self._reporting(state=ServoState.FOLLOWING, fault=None)

    def raising(self, height: float, config: ServoConfig) -> Memory:
        """Return the memory of a servo that raises the hand, now at a height [m]."""
        top = height + config.rise if self.top is None else self.top
        there = self.status.state is ServoState.HOLDING or height > top - _THERE
        state = ServoState.HOLDING if there else ServoState.RAISING
        return dc.replace(self._reporting(state=state, fault=None), top=top)

    def compared(
        self, frame: int, p_WG: Vector, config: ServoConfig
    ) -> tuple[Memory, bool]:
        """Return the memory after an image, and whether the image is stale.

        Args:
            frame: Frame of the image.
            p_WG: Position of the hand, shape (3,) [m].
            config: Least motion of the hand after which an equal image is stale.
        """
        if frame != self.frame:
            return dc.replace(self, frame=frame, p_frame=p_WG, same=0), False
        moved = float(np.linalg.norm(p_WG - self.p_frame))
        return dc.replace(self, same=self.same + 1), moved > config.moved

    def waited(self, time: float, config: ServoConfig) -> Memory:
        """Return the memory after a period without a new image."""
        memory = dc.replace(self, next_look=time)
        if time - self.heard < config.patience * config.camera_period:
            return memory
        return memory._reporting(state=ServoState.FAILED, fault=ServoFault.SILENT)

    def missed_one(self, fault: ServoFault, config: ServoConfig) -> Memory:
        """Return the memory after an image that does not determine the goal."""
        missed = self.missed + 1
        lost = max(missed, self.same) >= config.patience
        state = ServoState.FAILED if lost else ServoState.TRACKING
        return dc.replace(
            self._reporting(state=state, fault=fault), missed=missed, near_goal=0
        )

    def seen(
        self, p_WG: Vector, p_goal: Vector, time: float, config: ServoConfig
    ) -> Memory:
        """Return the memory after an image that shows the goal.

        Args:
            p_WG: Position of the hand at the image's time, shape (3,) [m].
            p_goal: Its goal in world, shape (3,) [m].
            time: Time of the image [s].
            config: Tolerances, and whether the goal moves.
        """
        if self.goal is None:
            goal = MovingGoal(p_goal, time=time)
        else:
            beta = _BETA if config.feed_forward else 0.0
            goal = self.goal.seen(p_goal, time, _ALPHA, beta)
        memory = dc.replace(self, goal=goal, missed=0)
        memory = memory._reporting(fault=None, images=self.status.images + 1)
        return memory._close(float(np.linalg.norm(p_goal - p_WG)), config)

    def near(self, p_WG: Vector, time: float, config: ServoConfig) -> Memory:
        """Return the memory after a period in which no image was read."""
        assert self.goal is not None, "each used image shows the goal"
        return self._close(float(np.linalg.norm(self.goal.at(time) - p_WG)), config)

    def _close(self, error: float, config: ServoConfig) -> Memory:
        assert self.goal is not None
        near, first = error < config.tolerance, self.near_goal == 0
        near_since = self.heard if first else self.near_since
        # Images that were taken before the first one arrived do not count: the hand
        # could not react to the first one yet.
        counts = first or self.taken >= near_since
        near_goal = self.near_goal + counts if near else 0
        reached = near_goal >= config.settled
        state = ServoState.REACHED if reached else ServoState.TRACKING
        memory = self._reporting(state=state, error=error, velocity=self.goal.v_W)
        return dc.replace(memory, near_goal=near_goal, near_since=near_since)

    def stepped(self, made: JointStep, twist: Vector, config: ServoConfig) -> Memory:
        """Return the memory after a step of the arm towards a twist of the hand."""
        moves = np.linalg.norm(twist[:3]) > _SLOW
        stuck = self.stuck + 1 if moves and made.achieved < _NO_STEP else 0
        v = (made.q - self.status.q) / config.period
        memory = self._reporting(q=made.q, at_rest=not np.any(twist))
        if stuck * config.period >= config.patience * config.camera_period:
            memory = memory._reporting(state=ServoState.FAILED, fault=ServoFault.STUCK)
        return dc.replace(memory, twist=twist, stuck=stuck, v=v)

    def _reporting(self, **changes: Any) -> Memory:
        return dc.replace(self, status=dc.replace(self.status, **changes))
