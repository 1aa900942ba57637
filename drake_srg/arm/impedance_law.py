"""Springs and dampers that a torque-controlled arm imitates.

Hogan, "Impedance Control: An Approach to Manipulation", J. Dyn. Sys., Meas., Control
107 (1985): an arm that touches things behaves as a spring and a damper between itself
and an equilibrium position. The inertia stays the arm's own, so that no force needs to
be measured: Ott, "Cartesian Impedance Control of Redundant and Flexible-Joint Robots",
Springer (2008).
"""

from __future__ import annotations

import abc

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from drake_srg.types import Vector

# Directions in which forces move the hand by less than this share of the easiest count
# as locked: near a singular posture, the null space takes them.
_SINGULAR = 1e-4


class Spring(abc.ABC):
    """A spring between an arm and its equilibrium."""

    @abc.abstractmethod
    def pull(self, q: Vector, q_0: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the spring's torques, its stiffness and the arm's inertia.

        Args:
            q: Joint positions (N) [rad].
            q_0: Those of the equilibrium (N) [rad].

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
        """See `Spring`."""
        torque = self.stiffness * (q_0 - q)
        return torque, np.diag(self.stiffness), self.inertia(q)

    def inertia(self, q: Vector) -> Vector:
        """Return the inertia matrix (N, N) [kg m²] with the motors' rotors."""
        self.plant.SetPositions(self._context, self._arm, q)
        M: Vector = self.plant.CalcMassMatrix(self._context)
        return M[np.ix_(self._own, self._own)]

    def forward(self, frame: Frame, p_FC: Vector, q: Vector) -> tuple[Vector, ...]:
        """Return position (3) [m], rotation (3, 3) and Jacobian (6, N) of a point C.

        The Jacobian's rows are rotation, then translation, in world.
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

    Torsion springs in the joints act in the null space besides: on what moves the
    joints, not the hand. They are projected as in Khatib, "A Unified Approach for
    Motion and Force Control of Robot Manipulators", IEEE J. Robotics Autom. 3 (1987),
    so that they change no force of the hand at rest.

    Args:
        joints: The springs of the joints.
        frame: A frame of their plant.
        p_FC: The centre of stiffness in that frame, shape (3,) [m].
        translation: Along the world's axes, shape (3,) [N/m].
        rotation: About every axis [N m/rad].
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
        """See `Spring`."""
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
        ratio: 1 is critical.
    """
    w, Q = _modes(inertia, stiffness)
    damping: Vector = (2.0 * ratio * w) * Q @ Q.T
    return damping


def natural_frequencies(inertia: Vector, stiffness: Vector) -> Vector:
    """Return the natural frequencies (N) [rad/s] of a spring and an inertia."""
    return _modes(inertia, stiffness)[0]


def _modes(inertia: Vector, stiffness: Vector) -> tuple[Vector, Vector]:
    """Return the frequencies w (N) and the Q (N, N) of `damping_matrix`."""
    L = np.linalg.cholesky(inertia)
    L_inv = np.linalg.inv(L)
    squares, U = np.linalg.eigh(L_inv @ stiffness @ L_inv.T)
    return np.sqrt(np.maximum(squares, 0.0)), L @ U


def is_stable(phase: float, ratio: float) -> bool:
    """Return whether a mode comes to rest under torques that are sampled and late.

    The spring and the damper see the state once per period, and their torque acts one
    period later, for one period. The latter is the most by which the steps of a plant
    delay it. All else is exact: the mode's motion within a period has no other force.

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
