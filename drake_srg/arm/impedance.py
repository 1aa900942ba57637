"""Compliant control of an arm: the impedance law and its driver.

The arm behaves as if a spring and a damper connected it to an equilibrium position
(Hogan, "Impedance Control: An Approach to Manipulation", J. Dyn. Sys., Meas., Control
107, 1985). It keeps its own inertia, so no force sensor is needed (Ott, "Cartesian
Impedance Control of Redundant and Flexible-Joint Robots", Springer, 2008).
"""

import abc
import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, Joint, ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
)

from drake_srg.arm.driver import AddSampling, ArmDriver, ArmSignals, stiff_gains
from drake_srg.common.systems import model_actuators, moving_joints
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Directions in which the hand's mobility is less than this share of the largest one
# count as locked. Near a singular posture, they belong to the null space.
_SINGULAR = 1e-4


class Spring(abc.ABC):
    """A spring between an arm and its equilibrium position."""

    @abc.abstractmethod
    def pull(self, q: Vector, q_0: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the spring's torques, its stiffness and the arm's inertia.

        Args:
            q: Joint positions (N) [rad].
            q_0: Joint positions of the equilibrium (N) [rad].

        Returns:
            Torques (N) [N m], a symmetric stiffness matrix without negative
            eigenvalues (N, N) [N m/rad], and the inertia matrix (N, N) [kg m²].
        """


class JointSpring(Spring):
    """A torsion spring in every joint.

    Args:
        plant: A finalized plant with the arm.
        arm: Name of its model instance.
        stiffness: Shape (N) [N m/rad].
    """

    def __init__(self, plant: MultibodyPlant, arm: str, stiffness: Vector) -> None:
        self.plant = plant
        self.stiffness = np.asarray(stiffness, dtype=float)
        self._context = plant.CreateDefaultContext()  # scratch, not state
        self._arm = plant.GetModelInstanceByName(arm)
        every = np.arange(plant.num_velocities(), dtype=float)
        self._own = plant.GetVelocitiesFromArray(self._arm, every).astype(int)

    def pull(self, q: Vector, q_0: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the spring's torques, its stiffness and the arm's inertia."""
        torque = self.stiffness * (q_0 - q)
        return torque, np.diag(self.stiffness), self.inertia(q)

    def inertia(self, q: Vector) -> Vector:
        """Return the inertia matrix (N, N) [kg m²], including the motors' rotors."""
        self.plant.SetPositions(self._context, self._arm, q)
        M: Vector = self.plant.CalcMassMatrix(self._context)
        return M[np.ix_(self._own, self._own)]

    def forward(self, frame: Frame, p_FC: Vector, q: Vector) -> tuple[Vector, ...]:
        """Return position (3) [m], rotation (3, 3) and Jacobian (6, N) of a point C.

        The Jacobian's rows are three for rotation, then three for translation, in
        world.
        """
        plant, context = self.plant, self._context
        plant.SetPositions(context, self._arm, q)
        X_WF = frame.CalcPoseInWorld(context)
        J = plant.CalcJacobianSpatialVelocity(
            context,
            JacobianWrtVariable.kV,
            frame,
            p_FC,
            plant.world_frame(),
            plant.world_frame(),
        )
        return X_WF @ p_FC, X_WF.rotation().matrix(), J[:, self._own]


class CartesianSpring(Spring):
    """A spring between a frame of the arm and its pose in the equilibrium.

    Torsion springs in the joints act only in the null space: on motions of the joints
    that do not move the hand. They are projected as in Khatib, "A Unified Approach for
    Motion and Force Control of Robot Manipulators", IEEE J. Robotics Autom. 3 (1987),
    so that they do not change the force of the hand at rest.

    Args:
        joints: The springs of the joints.
        frame: A frame of the joints' plant.
        p_FC: The centre of stiffness in that frame, shape (3,) [m].
        translation: Stiffness along the world's axes, shape (3,) [N/m].
        rotation: Stiffness about every axis [N m/rad].
    """

    def __init__(
        self,
        joints: JointSpring,
        frame: Frame,
        p_FC: Vector,
        translation: Vector,
        rotation: float,
    ) -> None:
        self._joints = joints
        self._frame, self._p_FC = frame, np.asarray(p_FC, dtype=float)
        self._stiffness = np.array([rotation, rotation, rotation, *translation])

    def pull(self, q: Vector, q_0: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the spring's torques, its stiffness and the arm's inertia."""
        p_0, R_0, _ = self._joints.forward(self._frame, self._p_FC, q_0)
        p, R, J = self._joints.forward(self._frame, self._p_FC, q)
        _, K_own, M = self._joints.pull(q, q_0)
        turn = RotationMatrix(R_0 @ R.T).ToAngleAxis()
        error = np.concatenate([turn.angle() * turn.axis(), p_0 - p])
        J_over_M = np.linalg.solve(M, J.T).T
        ease, U = np.linalg.eigh(J @ J_over_M.T)
        moves = ease > _SINGULAR * ease[-1]
        inverse = np.where(moves, 1.0 / np.where(moves, ease, 1.0), 0.0)
        N = np.eye(len(q)) - (J.T @ U * inverse) @ (U.T @ J_over_M)
        K_null = N @ K_own @ N.T
        torque = J.T @ (self._stiffness * error) + K_null @ (q_0 - q)
        K = J.T @ (self._stiffness[:, None] * J) + K_null
        return torque, K, M


def damping_matrix(inertia: Vector, stiffness: Vector, ratio: float) -> Vector:
    """Return the damping matrix that gives every mode the same damping ratio.

    This is the double diagonalization design of Albu-Schäffer, Ott, Frese and
    Hirzinger, "Cartesian Impedance Control of Redundant Robots: Recent Results with the
    DLR-Light-Weight-Arms", ICRA (2003): M = Q Qᵀ, K = Q diag(w²) Qᵀ and
    D = Q diag(2 ratio w) Qᵀ, where w are the natural frequencies.

    Args:
        inertia: M, shape (N, N), positive definite.
        stiffness: K, shape (N, N), symmetric, without negative eigenvalues.
        ratio: Damping ratio; 1 is critical.
    """
    w, Q = _modes(inertia, stiffness)
    damping: Vector = (2.0 * ratio * w) * Q @ Q.T
    return damping


def natural_frequencies(inertia: Vector, stiffness: Vector) -> Vector:
    """Return the natural frequencies (N) [rad/s] of a spring and an inertia."""
    return _modes(inertia, stiffness)[0]


def _modes(inertia: Vector, stiffness: Vector) -> tuple[Vector, Vector]:
    """Return w (N) and Q (N, N); see `damping_matrix`."""
    L = np.linalg.cholesky(inertia)
    L_inv = np.linalg.inv(L)
    squares, U = np.linalg.eigh(L_inv @ stiffness @ L_inv.T)
    return np.sqrt(np.maximum(squares, 0.0)), L @ U


def is_stable(phase: float, ratio: float) -> bool:
    """Return whether a mode comes to rest under sampled, delayed torques.

    Spring and damper sample the state once per period. Their torque begins to act one
    period later, the longest delay that a plant's steps cause, and acts for one period.
    Apart from this delay, the model is exact, because no other force acts on the mode
    within a period.

    Args:
        phase: Natural frequency times period [rad].
        ratio: Damping ratio.
    """
    step = np.array(
        [
            [1.0, 1.0, 0.5],
            [0.0, 1.0, 1.0],
            [-(phase**2), -2.0 * ratio * phase, 0.0],
        ]
    )
    return bool(np.max(np.abs(np.linalg.eigvals(step))) < 1.0)


def largest_phase(ratio: float) -> float:
    """Return the largest stable phase of `is_stable`, rounded down to 0.001 [rad]."""
    low, high = 0.0, 2.0
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_stable(middle, ratio) else (low, middle)
    return float(np.floor(1e3 * low) / 1e3)


_POSTURES = 100  # number of postures, besides home, in which stability is checked


@dc.dataclass(kw_only=True)
class CartesianStiffness(Config):
    """Stiffness of the hand, with the ranges and defaults of KUKA's Sunrise.OS.

    (CartesianImpedanceControlMode: 0 to 5000 N/m, 0 to 300 N m/rad; by default, 2000
    N/m and 200 N m/rad.)
    """

    # A frame of the arm or of a body welded to it, and the centre of stiffness in that
    # frame [m]. A force at this centre causes no rotation.
    frame: str = "arm::flange"
    centre: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )
    # Along the world's axes [N/m].
    translation: list[float] = dc.field(
        default_factory=lambda: [2000.0, 2000.0, 2000.0],
        metadata={"length": 3, "ge": 0.0, "le": 5000.0},
    )
    # About every axis [N m/rad].
    rotation: float = dc.field(default=200.0, metadata={"ge": 0.0, "le": 300.0})


@dc.dataclass(kw_only=True)
class ArmImpedanceDriver(ArmDriver):
    """Impedance control with gravity compensation, for torque-controlled arms.

    The arm behaves as if springs and dampers pulled it to the commanded positions.
    `ImpedanceControl` computes the torques; the top of this module names the sources.
    """

    # Stiffness of the joints [N m/rad]. With `cartesian`, it acts only in the null
    # space: on motions that do not move the hand. Null: a quarter of the stiffness from
    # `stiff_gains`, with natural frequencies of about 20 rad/s.
    joint_stiffness: list[float] | None = dc.field(default=None, metadata={"ge": 0.0})
    # Stiffness of the hand; null: only the joints have stiffness.
    cartesian: CartesianStiffness | None = None
    # Damping ratio; 1 is critical. Range and default are those of Sunrise.OS.
    damping_ratio: float = dc.field(default=0.7, metadata={"ge": 0.1, "le": 1.0})
    # Largest torques of springs and dampers together [N m], one entry per joint; null:
    # the motors' limits. Torques against gravity come on top.
    max_torque: list[float] | None = dc.field(default=None, metadata=positive())

    def prepare_plant(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver, before the plant is finalized."""
        super().prepare_plant(plant, arm)
        n = len(model_actuators(plant, arm))
        for key in ("joint_stiffness", "max_torque"):
            if (values := getattr(self, key)) is not None:
                self.check_length(key, values, n)

    def AddControl(
        self,
        inner: DiagramBuilder,
        control_plant: MultibodyPlant,
        arm: str,
        signals: ArmSignals,
    ) -> None:
        """Add the control, and export `desired_state`, `actuation` or both."""
        spring = self._spring(control_plant, arm)
        model = control_plant.GetModelInstanceByName(arm)
        joints = moving_joints(control_plant, model)
        self._check_stability(spring, joints)
        limits = signals.effort_limits
        control = inner.AddNamedSystem(
            "impedance_control",
            ImpedanceControl(
                spring,
                self.damping_ratio,
                max_torque=limits
                if self.max_torque is None
                else np.array(self.max_torque),
                max_acceleration=np.concatenate(
                    [joint.acceleration_upper_limits() for joint in joints]
                ),
                effort_limits=limits,
                period=self.period,
            ),
        )
        inner.Connect(signals.desired, control.GetInputPort("desired_state"))
        inner.Connect(signals.measured, control.GetInputPort("state_measured"))
        if signals.gravity is not None:
            inner.Connect(signals.gravity, control.GetInputPort("gravity"))
        torque = AddSampling(inner, control.get_output_port(), self.period)
        inner.ExportOutput(torque, "actuation")

    def _spring(self, plant: MultibodyPlant, arm: str) -> Spring:
        if self.joint_stiffness is None:
            model = plant.GetModelInstanceByName(arm)
            stiffness = 0.25 * stiff_gains(plant, model, np.array(self.home))[0]
        else:
            stiffness = np.array(self.joint_stiffness)
        joints = JointSpring(plant, arm, stiffness)
        if self.cartesian is None:
            return joints
        try:
            frame = GetScopedFrameByName(plant, self.cartesian.frame)
        except RuntimeError:
            raise ValueError(
                f"arm.cartesian.frame: unknown frame {self.cartesian.frame!r} "
                "(allowed: MODEL::FRAME of a model among the directives)"
            ) from None
        return CartesianSpring(
            joints,
            frame,
            np.array(self.cartesian.centre),
            np.array(self.cartesian.translation),
            self.cartesian.rotation,
        )

    def _check_stability(self, spring: Spring, joints: Sequence[Joint]) -> None:
        """Refuse a stiffness with which the sampled law is unstable.

        Raises:
            ValueError: If a natural frequency is too high for `period` in some posture.
        """
        lower = np.concatenate([joint.position_lower_limits() for joint in joints])
        upper = np.concatenate([joint.position_upper_limits() for joint in joints])
        postures = np.random.default_rng(0).uniform(
            np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (_POSTURES, len(lower))
        )
        fastest = 0.0
        for q in (np.array(self.home), *postures):
            _, K, M = spring.pull(q, q)
            fastest = max(fastest, float(natural_frequencies(M, K)[-1]))
        longest = largest_phase(self.damping_ratio) / max(fastest, 1e-9)
        if self.period > longest:
            longest = np.floor(1e4 * longest) / 1e4
            raise ValueError(
                f"arm.period: {self.period:g} s is too long for this stiffness, with "
                f"which the arm swings at up to {fastest:.3g} rad/s and "
                f"damping_ratio {self.damping_ratio:g} "
                f"(allowed: up to {longest:g} s, or less stiffness)"
            )


class ImpedanceControl(LeafSystem):
    """Computes the torques of a compliant arm.

    .. pydrake_system::

        name: ImpedanceControl
        input_ports:
        - desired_state
        - state_measured
        - gravity (optional)
        output_ports:
        - torque

    `desired_state` and `state_measured` (2N) are [q; v]. `desired_state` is the
    spring's equilibrium, and the damper acts on the difference of the velocities. The
    system adds `gravity` (N) [N m] and the torques that accelerate the arm together
    with the equilibrium, so a free arm follows without lag. `torque` (N) [N m] stays
    within the motors' limits.

    Args:
        spring: Spring of the arm.
        damping_ratio: Damping ratio of every mode; 1 is critical.
        max_torque: Largest torques of spring and damper (N) [N m].
        max_acceleration: Largest accelerations of the equilibrium that count (N)
            [rad/s²]; commands may jump.
        effort_limits: Largest total torques (N) [N m].
        period: Time between samples of `torque` [s].
    """

    def __init__(
        self,
        spring: Spring,
        damping_ratio: float,
        *,
        max_torque: Vector,
        max_acceleration: Vector,
        effort_limits: Vector,
        period: float,
    ) -> None:
        super().__init__()
        self._spring, self._ratio, self._period = spring, damping_ratio, period
        self._max_torque, self._limits = max_torque, effort_limits
        self._max_acceleration = max_acceleration
        n = len(effort_limits)
        self._desired = self.DeclareVectorInputPort("desired_state", 2 * n)
        self._measured = self.DeclareVectorInputPort("state_measured", 2 * n)
        self._gravity = self.DeclareVectorInputPort("gravity", n)
        self._last_speed = self.DeclareDiscreteState(n)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._keep_speed)
        self.DeclareVectorOutputPort(
            "torque",
            n,
            self._calc_torque,
            prerequisites_of_calc={
                self.all_input_ports_ticket(),
                self.discrete_state_ticket(self._last_speed),
            },
        )

    def _keep_speed(self, context: Context, state: DiscreteValues) -> None:
        n = len(self._limits)
        state.set_value(self._last_speed, self._desired.Eval(context)[n:])

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        q_0, v_0 = np.split(self._desired.Eval(context), 2)
        q, v = np.split(self._measured.Eval(context), 2)
        torque, K, M = self._spring.pull(q, q_0)
        torque = torque + damping_matrix(M, K, self._ratio) @ (v_0 - v)
        torque = np.clip(torque, -self._max_torque, self._max_torque)
        last = context.get_discrete_state(self._last_speed).value()
        acceleration = (v_0 - last) / self._period
        bound = self._max_acceleration
        torque = torque + M @ np.clip(acceleration, -bound, bound)
        if self._gravity.HasValue(context):
            torque = torque + self._gravity.Eval(context)
        output.SetFromVector(np.clip(torque, -self._limits, self._limits))
