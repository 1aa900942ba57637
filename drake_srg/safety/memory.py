"""What a safety monitor remembers, as numbers of its discrete state."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np

from drake_srg.common.safety_states import (
    SafetyState,
    StopReason,
    safety_state,
    state_indices,
)
from drake_srg.safety.limits import Command
from drake_srg.safety.path import Path
from drake_srg.types import Vector

_HEAD = 8  # numbers before the vectors


@dc.dataclass(frozen=True)
class Memory:
    """The memory of a monitor.

    Attributes:
        path: Where the arm is on the path of the commands.
        command: The last command that was accepted.
        state: The state.
        reason: Why the arm is stopped.
        rate: Speed along the path, 0 .. 1.
        pressed_since: Since when the force is above its quasi-static limit [s];
            infinite if it is not.
        release_pressed: Whether `release` was nonzero in the last update.
        cut: Whether commands are ignored: one of them was at fault, or they do not
            begin where the arm rests.
    """

    path: Path
    command: Command
    state: SafetyState = SafetyState.RUNNING
    reason: StopReason = StopReason.NONE
    rate: float = 1.0
    pressed_since: float = math.inf
    release_pressed: bool = False
    cut: bool = False

    @classmethod
    def at_rest(cls, q: Vector, command: Command) -> Memory:
        """Return the memory of an arm that rests at `q` (N,)."""
        return cls(Path.at_rest(q), command)

    @property
    def indices(self) -> list[float]:
        """The indices of state and reason."""
        return state_indices(self.state, self.reason)

    def flat(self) -> Vector:
        """Return everything but `path.ahead` as one vector."""
        path, command = self.path, self.command
        return np.concatenate(
            [
                [
                    *self.indices,
                    self.rate,
                    self.pressed_since,
                    self.release_pressed,
                    self.cut,
                    path.passed,
                    len(path.ahead),
                ],
                path.q,
                path.step,
                path.tangent,
                command.q,
                command.step,
                command.tool,
            ]
        )

    @staticmethod
    def position(flat: Vector, n: int) -> Vector:
        """Return `path.q` of a vector from `flat`, shape (N,)."""
        return flat[_HEAD : _HEAD + n]

    @classmethod
    def of(cls, flat: Vector, ahead: Vector, n: int) -> Memory:
        """Return the memory that `flat` and the numbers of `path.ahead` make.

        Args:
            flat: From `flat`.
            ahead: Begins with the numbers of `path.ahead`.
            n: Number of joints.
        """
        head, vectors = flat[:_HEAD].tolist(), flat[_HEAD:].copy()
        q, step, tangent, commanded, command_step = vectors[: 5 * n].reshape(5, n)
        rows = int(head[7])
        return cls(
            Path(q, step, ahead[: rows * n].reshape(rows, n).copy(), head[6], tangent),
            Command(commanded, command_step, vectors[5 * n :]),
            *safety_state(flat),
            head[2],
            head[3],
            bool(head[4]),
            bool(head[5]),
        )
