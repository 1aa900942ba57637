"""The path of the commands, and a monitor's memory of it."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np

from drake_srg.arm.safety.limits import Command
from drake_srg.common.safety_states import (
    SafetyState,
    StopReason,
    safety_state,
    state_indices,
)
from drake_srg.types import Vector

# An acceleration below this is a rounding error.
_SLACK = 1e-12


@dc.dataclass(frozen=True)
class Path:
    """A point that moves along the line through a sequence of commands.

    Distance along the path is measured in commands: at full speed, the point moves by
    one command in each control period.

    Attributes:
        q: Position of the point, shape (N,).
        step: The point's last step, shape (N,).
        ahead: The commands that the point has not reached yet, shape (M, N).
        passed: Distance of `q` from the last passed command, 0 <= passed < 1.
        tangent: The path's direction at `q`, per command, shape (N,).
    """

    q: Vector
    step: Vector
    ahead: Vector
    passed: float
    tangent: Vector

    @classmethod
    def at_rest(cls, q: Vector) -> Path:
        """Return a path that consists only of its point."""
        nothing = np.zeros_like(q)
        return cls(q, nothing, np.empty((0, len(q))), 0.0, nothing)

    def extended(self, command: Vector) -> Path:
        """Return the path with one more command, unless it repeats the last one."""
        if np.array_equal(command, self.end):
            return self
        return dc.replace(self, ahead=np.vstack([self.ahead, command]))

    @property
    def end(self) -> Vector:
        """The last command, or the point if none is ahead, shape (N,)."""
        end: Vector = self.ahead[-1] if len(self.ahead) else self.q
        return end

    @property
    def rate(self) -> float:
        """Speed of the last step, as a share of the commands' speed, 0 .. 1."""
        commanded = float(np.linalg.norm(self.tangent))
        gone = float(np.linalg.norm(self.step))
        return min(gone / commanded, 1.0) if gone else 0.0

    def taken(self, reach: Vector) -> Path | None:
        """Return the path after a step exactly to its only command.

        The result is None if there is not exactly one command, or if a joint's step
        would change by more than `reach`, shape (N,).
        """
        if len(self.ahead) != 1 or self.passed > 0.0:
            return None
        q = self.ahead[0]
        step = q - self.q
        if (np.abs(step - self.step) > reach + _SLACK).any():
            return None
        return Path(q, step, self.ahead[:0], 0.0, step)

    def advanced(self, rate: float, reach: Vector) -> Path:
        """Return the path one period later.

        The point goes the distance nearest to `rate` at which no joint's step changes
        by more than `reach`. If the path ends before the point can come to rest, the
        point continues straight on. If the path is too crooked to follow within
        `reach`, the point leaves it and brakes as hard as allowed, and the rest of the
        path is discarded.

        Args:
            rate: Distance to go, 0 .. 1.
            reach: Largest change of each joint's step, shape (N,).
        """
        straight_on = self.q + self.step
        slack = reach + _SLACK
        best: tuple[float, float, Vector] | None = None
        for start, length, corner, following in self._pieces():
            direction = (following - corner) / length
            allowed = min(length, 1.0 - start)
            span = _span(corner - straight_on, direction, allowed, slack)
            if span is None:
                continue
            u = min(max(rate - start, span[0]), span[1])
            miss = abs(start + u - rate)
            if best is None or miss < best[0]:
                # Commands are reached exactly, despite rounding.
                q = following if u == length else corner + u * direction
                best = (miss, start + u, q)
        if best is not None:
            return self._moved(best[1], best[2])
        if not len(self.ahead) and np.all(np.abs(self.step) <= slack):
            return self._moved(0.0, self.q)
        end = len(self.ahead) - self.passed
        corner, tangent = self.end, self._direction(len(self.ahead))
        span = _span(corner - straight_on, tangent, 1.0, slack)
        if span is not None and end + span[0] <= 1.0 + _SLACK:
            return self._moved(end + span[0], corner + span[0] * tangent)
        step = self.step - np.clip(self.step, -reach, reach)
        return Path(self.q + step, step, self.ahead[:0], 0.0, step)

    def _pieces(self) -> list[tuple[float, float, Vector, Vector]]:
        """Return start, length, first and last point of the pieces within reach."""
        pieces = []
        left = 1.0 - self.passed
        if len(self.ahead):
            pieces.append((0.0, left, self.q, self.ahead[0]))
        if left < 1.0 and len(self.ahead) > 1:
            pieces.append((left, 1.0, self.ahead[0], self.ahead[1]))
        return pieces

    def _direction(self, i: int) -> Vector:
        """Return the path's direction before command `i` of `ahead`, per command."""
        i = min(i, len(self.ahead) - 1)
        if i < 0:
            return self.tangent
        if i == 0:
            first: Vector = (self.ahead[0] - self.q) / (1.0 - self.passed)
            return first
        later: Vector = self.ahead[i] - self.ahead[i - 1]
        return later

    def _moved(self, distance: float, q: Vector) -> Path:
        """Return the path after the point has gone a distance, to `q`."""
        passed = self.passed + distance
        count = min(int(passed + _SLACK), len(self.ahead))
        ahead = self.ahead[count:]
        passed = max(passed - count, 0.0) if len(ahead) else 0.0
        return Path(q, q - self.q, ahead, passed, self._direction(count))


def _span(
    offset: Vector, direction: Vector, length: float, reach: Vector
) -> tuple[float, float] | None:
    """Return the least and greatest u with |offset + u direction| <= reach.

    The condition holds for each entry, and u is in 0 .. length. The result is None if
    there is no such u.
    """
    low, high = 0.0, length
    for o, d, r in zip(
        offset.tolist(), direction.tolist(), reach.tolist(), strict=True
    ):
        if d == 0.0:
            if abs(o) > r:
                return None
            continue
        first, last = (-r - o) / d, (r - o) / d
        if d < 0.0:
            first, last = last, first
        low, high = max(low, first), min(high, last)
    return (low, high) if low <= high else None


_HEAD = 8  # numbers before the vectors


@dc.dataclass(frozen=True)
class Memory:
    """The state of a monitor.

    Attributes:
        path: The arm's place on the path of the commands.
        command: The last command that was accepted.
        state: The safety state.
        reason: The reason of a stop.
        rate: Speed along the path, 0 .. 1.
        pressed_since: Time since which the force has exceeded its quasi-static limit
            [s]; infinite if it does not.
        release_pressed: Whether `release` was nonzero in the last update.
        cut: Whether commands are no longer followed, because one had a fault or they
            do not begin at the arm's rest position.
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
        """Return `path.q` from a vector made by `flat`, shape (N,)."""
        return flat[_HEAD : _HEAD + n]

    @classmethod
    def of(cls, flat: Vector, ahead: Vector, n: int) -> Memory:
        """Return the memory from its vectors.

        Args:
            flat: The vector from the method `flat`.
            ahead: An array that begins with the numbers of `path.ahead`.
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
