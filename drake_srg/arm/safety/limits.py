"""Limits of joints, tool and contact forces, and the check of a command."""

from __future__ import annotations

import dataclasses as dc
import functools
import math
from collections.abc import Callable

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, ModelInstanceIndex

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.common.safety_states import StopReason
from drake_srg.types import Vector

# Planned motions use limits fully. An excess up to this share is a rounding error.
_TOLERANCE = 1e-3
# Largest measured speed over the limit of commanded speeds.
_MEASURED_SPEED = 1.2
# Shares of the model's accelerations; see `SafetyConfig`.
_ACCELERATION, _STOP = 1.5, 4.0 / 3.0


@dc.dataclass(frozen=True)
class JointLimits:
    """Limits of N joints, each of shape (N,), per control period.

    Attributes:
        lower: Least positions [rad or m].
        upper: Greatest positions [rad or m].
        step: Largest change of position in a period [rad or m].
        bend: Largest change of a step from one period to the next, while running [rad
            or m].
        brake: The same in a stop; greater than `bend` [rad or m].
    """

    lower: Vector
    upper: Vector
    step: Vector
    bend: Vector
    brake: Vector

    @classmethod
    def of_plant(
        cls,
        plant: MultibodyPlant,
        arm: ModelInstanceIndex,
        config: SafetyConfig,
        period: float,
    ) -> JointLimits:
        """Return the limits of a configuration, completed by the model's.

        Args:
            plant: Plant with the arm.
            arm: Its model instance; all of its joints have one position or none.
            config: The limits.
            period: The control period [s].

        Raises:
            ValueError: If a limit does not fit the joints or another limit.
        """
        n = plant.num_positions(arm)

        def resolve(key: str, given: list[float] | None, default: Vector) -> Vector:
            if given is None:
                return default
            if len(given) not in (1, n):
                raise ValueError(
                    f"safety.{key}: needs 1 entry or one per joint of the arm ({n}), "
                    f"got {len(given)}"
                )
            return np.broadcast_to(np.array(given, dtype=float), n).copy()

        of_model = functools.partial(plant.GetVelocitiesFromArray, arm)
        lower, upper = (
            resolve(key, given, plant.GetPositionsFromArray(arm, limits))
            for key, given, limits in (
                ("lower", config.lower, plant.GetPositionLowerLimits()),
                ("upper", config.upper, plant.GetPositionUpperLimits()),
            )
        )
        speed = resolve("speed", config.speed, of_model(plant.GetVelocityUpperLimits()))
        model = _ACCELERATION * of_model(plant.GetAccelerationUpperLimits())
        acceleration = resolve("acceleration", config.acceleration, model)
        stop = _STOP * acceleration
        stop = resolve("stop_acceleration", config.stop_acceleration, stop)
        if not np.all(lower < upper):
            raise ValueError("safety.lower: must be less than safety.upper")
        if not np.all(stop[np.isfinite(stop)] > acceleration[np.isfinite(stop)]):
            raise ValueError(
                "safety.stop_acceleration: must be greater than safety.acceleration "
                f"({acceleration.max():g}), got {stop.min():g}"
            )
        for key, values in (("speed", speed), ("acceleration", acceleration)):
            if not np.all(np.isfinite(values)):
                raise ValueError(
                    f"safety.{key}: must be given, because the arm's model has no limit"
                )
        return cls(
            lower,
            upper,
            (1.0 + _TOLERANCE) * period * speed,
            (1.0 + _TOLERANCE) * period**2 * acceleration,
            (1.0 + _TOLERANCE) * period**2 * stop,
        )

    def fault(
        self, q: Vector, step: Vector, last_step: Vector, stopped: Vector
    ) -> StopReason:
        """Return the fault of a command, if any.

        Args:
            q: Its positions, shape (N,) [rad or m].
            step: Their change since the previous command, shape (N,).
            last_step: The previous change, shape (N,).
            stopped: Positions at which the arm would come to rest if it braked at `q`,
                shape (N,) [rad or m].
        """
        if (np.abs(step) > self.step).any():
            return StopReason.SPEED
        if (np.abs(step - last_step) > self.bend).any():
            return StopReason.ACCELERATION
        low, high = np.minimum(q, stopped), np.maximum(q, stopped)
        if (low < self.lower).any() or (high > self.upper).any():
            return StopReason.POSITION
        return StopReason.NONE

    def braking_periods(self, step: Vector) -> float:
        """Return the number of periods of a straight stop from a step (N,)."""
        return math.ceil(float(np.max(np.abs(step) / self.brake)))

    def measured_fault(
        self, measured: Vector, q: Vector, following_error: float, period: float
    ) -> StopReason:
        """Return the fault of a measured state [q; v], if any.

        Args:
            measured: The state, shape (2N,) [rad, rad/s].
            q: Expected positions, shape (N,) [rad or m].
            following_error: Largest deviation from `q` [rad or m].
            period: The control period [s].
        """
        n = len(q)
        # NaN compares as false, so one test finds all faults.
        near = (np.abs(measured[:n] - q) <= following_error).all()
        slow = (np.abs(measured[n:]) * period <= _MEASURED_SPEED * self.step).all()
        if near and slow:
            return StopReason.NONE
        if not np.isfinite(measured).all():
            return StopReason.MEASURED_NOT_FINITE
        return StopReason.MEASURED_SPEED if near else StopReason.FOLLOWING_ERROR


@dc.dataclass(frozen=True)
class ToolLimits:
    """Limits of the tool's point.

    Attributes:
        position: Returns the point's position p_WT [m] at joint positions (N,).
        step: Largest distance in a control period [m].
        lower: Least position in world, shape (3,) [m].
        upper: Greatest position in world, shape (3,) [m].
    """

    position: Callable[[Vector], Vector]
    step: float = math.inf
    lower: Vector = dc.field(default_factory=lambda: np.full(3, -np.inf))
    upper: Vector = dc.field(default_factory=lambda: np.full(3, np.inf))

    @classmethod
    def of(
        cls, config: SafetyConfig, position: Callable[[Vector], Vector], period: float
    ) -> ToolLimits | None:
        """Return the limits of a configuration, if it has any.

        Args:
            config: The limits.
            position: See the attribute `position`.
            period: The control period [s].

        Raises:
            ValueError: If the workspace is empty.
        """
        box = config.workspace
        if config.tool_speed is None and box is None:
            return None
        speed = math.inf if config.tool_speed is None else config.tool_speed
        if box is None:
            return cls(position, period * speed)
        if not np.all(np.less(box.min, box.max)):
            raise ValueError("safety.workspace.min: must be less than max everywhere")
        return cls(position, period * speed, np.array(box.min), np.array(box.max))

    def fault(self, p_WT: Vector, last: Vector, stopped: Vector) -> StopReason:
        """Return the fault of a command, if any.

        Args:
            p_WT: The tool's position in world [m].
            last: The same for the previous command [m].
            stopped: Joint positions at which the arm would come to rest if it braked,
                shape (N,) [rad or m].
        """
        if np.linalg.norm(p_WT - last) > self.step:
            return StopReason.TOOL_SPEED
        if self._outside(p_WT) or self._outside(self.position(stopped)):
            return StopReason.WORKSPACE
        return StopReason.NONE

    def _outside(self, p_WT: Vector) -> bool:
        return bool((p_WT < self.lower).any() or (p_WT > self.upper).any())


@dc.dataclass(frozen=True)
class Command:
    """A command that has been accepted, or the arm's rest position.

    Attributes:
        q: Joint positions, shape (N,) [rad or m].
        step: Their change since the previous command, shape (N,).
        tool: The tool's position p_WT at `q` [m]; NaN if no limit needs it.
    """

    q: Vector
    step: Vector
    tool: Vector


def check_command(
    q: Vector, last: Command, limits: JointLimits, tool: ToolLimits | None
) -> tuple[StopReason, Command]:
    """Return a command's fault, if any, and the command from which to continue.

    A command is also refused if the arm, once there, could not stop within the limits
    of position and workspace.

    Args:
        q: The command's joint positions, shape (N,) [rad or m].
        last: The previous command.
        limits: Limits of the joints.
        tool: Limits of the tool, if any.
    """
    if not np.isfinite(q).all():
        return StopReason.NOT_FINITE, last
    step = q - last.q
    # The arm would stop straight ahead, with all joints at the same time. One more step
    # accounts for rounding up to whole periods.
    stopped = q + step * (0.5 * limits.braking_periods(step) + 1.0)
    fault = limits.fault(q, step, last.step, stopped)
    p_WT = last.tool
    if tool is not None and fault is StopReason.NONE:
        p_WT = tool.position(q)
        fault = tool.fault(p_WT, last.tool, stopped)
    ok = fault is StopReason.NONE
    return fault, Command(q, step, p_WT) if ok else last


# Directions in which a force causes less than this share of the largest torques are
# ignored: near a singular posture, noise would look like an enormous force.
_RESOLVED = 0.05


class Tool:
    """A point of the hand, as a function of the arm's joints.

    Args:
        plant: A finalized plant with the arm and the hand.
        arm: Name of the arm's model instance.
        frame: The tool, as MODEL::FRAME; its origin counts.

    Raises:
        ValueError: If there is no such frame.
    """

    def __init__(self, plant: MultibodyPlant, arm: str, frame: str) -> None:
        self._plant = plant
        self._context = plant.CreateDefaultContext()  # scratch, not state
        self._arm = plant.GetModelInstanceByName(arm)
        self._frame = _find(plant, frame)
        joints = plant.GetJointIndices(self._arm)
        moving = (plant.get_joint(i) for i in joints)
        self._columns = sorted(j.velocity_start() for j in moving if j.num_velocities())

    def position(self, q: Vector) -> Vector:
        """Return the point's position p_WT [m] at joint positions (N,) [rad or m]."""
        self._plant.SetPositions(self._context, self._arm, q)
        X_WT = self._frame.CalcPoseInWorld(self._context)
        p_WT: Vector = X_WT.translation()
        return p_WT

    def force(self, q: Vector, torque: Vector) -> float:
        """Return the size of the force at the point that best explains torques [N].

        It is the least-squares solution of J(q)ᵀ f = torque, for a contact only at this
        point. The force of a contact nearer to the base is greater than the result.

        Args:
            q: Joint positions, shape (N,) [rad or m].
            torque: External torques, shape (N,) [N m].
        """
        plant = self._plant
        plant.SetPositions(self._context, self._arm, q)
        world = plant.world_frame()
        J = plant.CalcJacobianTranslationalVelocity(
            self._context,
            JacobianWrtVariable.kV,
            self._frame,
            np.zeros(3),
            world,
            world,
        )[:, self._columns]
        force = np.linalg.lstsq(J.T, torque, rcond=_RESOLVED)[0]
        return float(np.linalg.norm(force))


def _find(plant: MultibodyPlant, name: str) -> Frame:
    model, _, frame = name.partition("::")
    if frame and plant.HasModelInstanceNamed(model):
        instance = plant.GetModelInstanceByName(model)
        if plant.HasFrameNamed(frame, instance):
            return plant.GetFrameByName(frame, instance)
    raise ValueError(
        f"safety.tool: must be a frame of the models, as MODEL::FRAME, got {name!r}"
    )


@dc.dataclass(frozen=True)
class TouchLimits:
    """Limits of external torques, and of the equivalent force at the tool.

    Attributes:
        torque: Torque of each joint, shape (N,) [N m].
        tool: Point at which the force acts; None if the force has no limits.
        transient: Largest force [N].
        quasi_static: Largest force that lasts longer than `transient_time` [N].
        transient_time: Time for which a force counts as an impact [s].
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
        """Return the exceeded limit, if any, and the new value of `since`.

        Args:
            q: Joint positions, shape (N,) [rad or m].
            torque: External torques, shape (N,) [N m].
            since: Time since which the force has exceeded `quasi_static` [s]; infinite
                if it has not.
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
