"""Limits of what the arm feels from outside: power and force limiting."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np

from drake_srg.common.safety_states import StopReason
from drake_srg.safety.config import SafetyConfig
from drake_srg.safety.tool import Tool
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class TouchLimits:
    """Limits of external torques, and of the force that explains them.

    Attributes:
        torque: Of each joint, shape (N,) [N m].
        tool: Where the force acts; None without limits of the force.
        transient: Largest force [N].
        quasi_static: Largest force that lasts longer than `transient_time` [N].
        transient_time: How long a force counts as an impact [s].
    """

    torque: Vector
    tool: Tool | None = None
    transient: float = math.inf
    quasi_static: float = math.inf
    transient_time: float = 0.0

    @classmethod
    def of(cls, config: SafetyConfig, n: int, tool: Tool | None) -> TouchLimits | None:
        """Return the limits of a configuration for N = `n` joints, if it has any.

        Raises:
            ValueError: If they do not fit the arm, or name unknown regions of the body.
        """
        if not config.feels:
            return None
        given = config.external_torque
        given = [math.inf] if given is None else given
        if len(given) not in (1, n):
            raise ValueError(
                "safety.external_torque: needs 1 entry or one per joint of the arm "
                f"({n}), got {len(given)}"
            )
        torque, force = np.broadcast_to(np.array(given, dtype=float), n), config.force
        if force is None:
            return cls(torque)
        if not force.regions or set(force.regions) - force.profile.keys():
            raise ValueError(
                "safety.force.regions: must name regions of the profile, got "
                f"{force.regions} (allowed: {', '.join(force.profile) or 'none'})"
            )
        regions = [force.profile[name] for name in force.regions]
        return cls(
            torque,
            tool,
            min(region.transient for region in regions),
            min(region.quasi_static for region in regions),
            force.transient_time,
        )

    def fault(
        self, q: Vector, torque: Vector, since: float, time: float
    ) -> tuple[StopReason, float]:
        """Return what is beyond a limit, if anything, and since when the tool presses.

        Args:
            q: Joint positions, shape (N,) [rad or m].
            torque: External torques, shape (N,) [N m].
            since: Since when the force is above `quasi_static` [s]; infinite if it was
                not.
            time: Now [s].
        """
        if not np.isfinite(torque).all():
            return StopReason.MEASURED_NOT_FINITE, since
        if (np.abs(torque) > self.torque).any():
            return StopReason.EXTERNAL_TORQUE, since
        if self.tool is None:
            return StopReason.NONE, since
        force = self.tool.force(q, torque)
        since = min(since, time) if force > self.quasi_static else math.inf
        if force > self.transient or time - since > self.transient_time:
            return StopReason.FORCE, since
        return StopReason.NONE, since
