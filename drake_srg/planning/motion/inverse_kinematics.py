"""Inverse kinematics: joint angles for a target of the hand."""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from numpy.random import Generator, default_rng
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.solvers import (
    Binding,
    MathematicalProgramResult,
    SnoptSolver,
    SolverOptions,
)

from drake_srg.planning.motion.planning_scene import Clearance, PlanningScene
from drake_srg.types import Failure, Vector


@dc.dataclass(frozen=True)
class AxisTarget:
    """An axis of the hand that must point along a direction of the world."""

    axis_G: Vector  # shape (3,), in the hand
    direction_W: Vector  # shape (3,), in the world
    angle: float  # largest angle between the two [rad]


@dc.dataclass(frozen=True)
class HandTarget:
    """A target of the hand: a point, and a full orientation, axes, or neither."""

    p_WT: Vector  # target of the hand's point T [m], shape (3,)
    R_WG: RotationMatrix | None = None
    axes: tuple[AxisTarget, ...] = ()
    p_GT: Vector = dc.field(default_factory=lambda: np.zeros(3))  # T in the hand [m]
    position_tolerance: float = 1e-4  # half the side of a box around p_WT [m]
    angle_tolerance: float = 2e-3  # of R_WG [rad]

    @staticmethod
    def from_pose(X_WG: RigidTransform) -> HandTarget:
        """Return the target of the whole pose `X_WG` [m]."""
        return HandTarget(X_WG.translation(), X_WG.rotation())

    def shifted(self, p_W: Vector) -> HandTarget:
        """Return the same target, moved by `p_W` (3,) [m]."""
        return dc.replace(self, p_WT=self.p_WT + p_W)

    def distance(self, X_WG: RigidTransform) -> float:
        """Return the distance of the hand's point T from its target [m]."""
        return float(np.linalg.norm(X_WG @ self.p_GT - self.p_WT))

    def angle_violation(self, X_WG: RigidTransform) -> float:
        """Return the excess over the angular tolerances [rad], or 0."""
        beyond = [0.0]
        if self.R_WG is not None:
            R_error = self.R_WG.inverse() @ X_WG.rotation()
            beyond.append(R_error.ToAngleAxis().angle() - self.angle_tolerance)
        for axis in self.axes:
            axis_W = X_WG.rotation() @ axis.axis_G
            sine = np.linalg.norm(np.cross(axis_W, axis.direction_W))
            angle = np.arctan2(sine, axis_W @ axis.direction_W)
            beyond.append(float(angle) - axis.angle)
        return max(beyond)


# A solvable call needs 5 to 20 major iterations. A call that needs 60 would fail
# anyway.
_OPTIONS = SolverOptions()
_OPTIONS.SetOption(SnoptSolver.id(), "Major iterations limit", 60)
JOINT_MARGIN = 0.02  # distance kept from the joint limits [rad]
# The cosine of an angle has no slope at 0, and SNOPT meets constraints to 1e-6: an axis
# with a smaller tolerance [rad] is constrained perpendicular to two normals of its
# direction.
_SMALL_ANGLE = 1.4e-3
_FINE = SolverOptions()
_FINE.SetOption(SnoptSolver.id(), "Major iterations limit", 60)
_FINE.SetOption(SnoptSolver.id(), "Major feasibility tolerance", 1e-9)

# A function that extends the problem before it is solved.
Extend: TypeAlias = Callable[[InverseKinematics], object]


class Requirement(enum.Enum):
    """Kinds of constraints of the problem; a failure names one of them."""

    POSITION = "position"
    ORIENTATION = "orientation"
    AXIS = "axis"
    JOINT_LIMITS = "joint_limits"
    MINIMUM_DISTANCE = "minimum_distance"
    OWN = "own"  # a constraint that the caller has added


@dc.dataclass(frozen=True)
class IkSolution:
    """Joint angles that meet every requirement."""

    q: Vector  # shape (N,) [rad]
    # Squared distance from the nominal posture [rad²], and the caller's own costs.
    cost: float
    clearance: Clearance | None  # None without collision checks


@dc.dataclass(frozen=True)
class IkFailure:
    """The requirement that cannot be met together with all others."""

    requirement: Requirement
    # In the best compromise found [m] or [rad]; for `OWN`, in the units of its bounds.
    violation: float
    message: str

    @property
    def failure(self) -> Failure:
        """The failure of the task: blocked by something, or out of reach."""
        if self.requirement is Requirement.MINIMUM_DISTANCE:
            return Failure.BLOCKED
        return Failure.OUT_OF_REACH


def solve_inverse_kinematics(
    scene: PlanningScene,
    target: HandTarget,
    *,
    q_nominal: Vector,
    q_guess: Vector | None = None,
    max_starts: int = 12,
    check_clearance: bool = True,
    extend: Extend | None = None,
) -> IkSolution | IkFailure:
    """Solve for a posture near a nominal one that reaches `target`.

    SNOPT solves a program of position, orientation and joint limits, and the scene
    judges the solution. Minimum distance is not part of the program: one solution with
    it takes ten times as long as another start without it. The first start is
    `q_guess`. Further ones are drawn at random, farther and farther away. Each also
    replaces the nominal posture of its program, which spreads the solutions of a
    redundant arm over its null space. The result is the first collision-free solution.
    The same call returns the same result.

    Args:
        scene: The arm, and what to keep clear of.
        target: Target of the hand.
        q_nominal: The posture with cost 0, shape (N,) [rad].
        q_guess: The first start, shape (N,) [rad]; None: `q_nominal`.
        max_starts: Largest number of starts.
        check_clearance: Whether solutions must be free in `scene`.
        extend: Adds your own constraints and costs to the problem before it is solved.
            Its argument is the `InverseKinematics` of the scene's plant. The arm's
            joints are `ik.q()[scene.arm_indices]`; no others move. Give constraints a
            description (`evaluator().set_description`): a failure names the one that
            cannot be met.

    Returns:
        The solution, or the requirement that cannot be met.

    Raises:
        ValueError: If a vector does not have N entries.
    """
    search = _Search(scene, target, q_nominal, q_guess, extend)
    return search.solution(max_starts, check_clearance) or search.failure()


def find_posture(
    scene: PlanningScene,
    target: HandTarget,
    *,
    q_nominal: Vector,
    q_guess: Vector | None = None,
    max_starts: int = 12,
    seed: int = 0,
) -> IkSolution | None:
    """Return a collision-free solution, or None.

    Unlike `solve_inverse_kinematics`, it does not look for the reason of a failure,
    which would take as long as several solutions.

    Args:
        scene: The arm, and what to keep clear of.
        target: Target of the hand.
        q_nominal: Preferred joint positions, shape (N,) [rad].
        q_guess: First start, shape (N,) [rad]; None: `q_nominal`.
        max_starts: Number of starts.
        seed: Seed of the random starts.

    Raises:
        ValueError: If a vector does not have N entries.
    """
    search = _Search(scene, target, q_nominal, q_guess, None)
    return search.solution(max_starts, check_clearance=True, seed=seed)


class _Search:
    """A search for a posture; see `solve_inverse_kinematics`."""

    def __init__(
        self,
        scene: PlanningScene,
        target: HandTarget,
        q_nominal: Vector,
        q_guess: Vector | None,
        extend: Extend | None,
    ) -> None:
        guess = q_nominal if q_guess is None else q_guess
        for name, vector in (("q_nominal", q_nominal), ("q_guess", guess)):
            if np.shape(vector) != (scene.num_joints,):
                raise ValueError(
                    f"{name} needs one entry per joint "
                    f"({', '.join(scene.joint_names)}), got shape {np.shape(vector)}"
                )
        self._scene, self._target, self._extend = scene, target, extend
        self._q_nominal, self._guess = q_nominal, guess
        self._limits = (scene.lower + JOINT_MARGIN, scene.upper - JOINT_MARGIN)
        self._blocked: list[Clearance] = []

    def solution(
        self, max_starts: int, check_clearance: bool, seed: int = 0
    ) -> IkSolution | None:
        """Return the first free solution, or None."""
        scene, q_nominal = self._scene, self._q_nominal
        program = _Program(scene, self._target, self._limits, extend=self._extend)
        for count, start in enumerate(
            _starts(self._limits, self._guess, default_rng(seed), max_starts), 1
        ):
            pull = q_nominal if count == 1 else start
            q, solved, own_cost = program.solve(start, pull)
            if not solved:
                continue
            clearance = scene.clearance(q) if check_clearance else None
            if clearance and clearance.spare < 0.0:
                self._blocked.append(clearance)
                continue
            cost = float(np.sum((q - q_nominal) ** 2)) + own_cost
            return IkSolution(q, cost, clearance)
        return None

    def failure(self) -> IkFailure:
        """Return why there was no free solution."""
        if self._blocked:
            clearance = max(self._blocked, key=lambda clearance: clearance.spare)
            return IkFailure(
                Requirement.MINIMUM_DISTANCE,
                -clearance.spare,
                f"minimum_distance: the pose is reached, but {clearance}",
            )
        return self._diagnosis()

    def _diagnosis(self) -> IkFailure:
        """Drop one requirement after another until the rest can be met."""
        scene, target, limits = self._scene, self._target, self._limits
        starts = list(_starts(limits, self._guess, default_rng(0), 4))
        if self._extend is not None:
            failure = self._own_failure(starts)
            if failure is not None:
                return failure
        turn = np.full(scene.num_joints, 2.0 * np.pi)

        unlimited = _Program(scene, target, (-turn, turn))
        for start in starts:
            q, solved, _ = unlimited.solve(start, start)
            beyond = np.maximum(limits[0] - q, q - limits[1])
            worst = int(np.argmax(beyond))
            if solved and beyond[worst] > 0.0:
                return IkFailure(
                    Requirement.JOINT_LIMITS,
                    float(beyond[worst]),
                    f"joint_limits: {scene.joint_names[worst]} would have to go "
                    f"{beyond[worst]:.3f} {scene.joint_units[worst]} beyond its limit",
                )

        if target.R_WG is not None or target.axes:
            free = _Program(scene, target, limits, soft_rotation=True)
            tries = [free.solve(start, start)[0] for start in starts]
            close = 2.0 * target.position_tolerance  # beyond the corner of the box
            reached = [q for q in tries if target.distance(scene.X_WG(q)) < close]
            if reached:
                angle = min(target.angle_violation(scene.X_WG(q)) for q in reached)
                kind = Requirement.ORIENTATION if target.R_WG else Requirement.AXIS
                return IkFailure(
                    kind,
                    angle,
                    f"{kind.value}: the position is reached, but the hand stays "
                    f"{np.degrees(angle):.1f} degrees beyond its tolerance",
                )

        near = _Program(scene, target, limits, soft_position=True)
        tries = [near.solve(start, start)[0] for start in starts]
        distance = min(target.distance(scene.X_WG(q)) for q in tries)
        return IkFailure(
            Requirement.POSITION,
            distance,
            f"position: the hand gets no nearer than {1e3 * distance:.0f} mm",
        )

    def _own_failure(self, starts: Sequence[Vector]) -> IkFailure | None:
        """Return which of the caller's constraints cannot be met, if any.

        The result names the first constraint without which all others can be met. If
        there is none, it names them all.
        """
        plain = _Program(self._scene, self._target, self._limits)
        if not any(plain.solve(start, start)[1] for start in starts):
            return None
        program = _Program(self._scene, self._target, self._limits, extend=self._extend)
        names = [
            own.evaluator().get_description() or f"constraint {number}"
            for number, own in enumerate(program.own, 1)
        ]
        for name, own in zip(names, program.own, strict=True):
            for start in starts:
                violation = program.solve_without(own, start)
                if violation is not None and violation > 0.0:
                    return IkFailure(
                        Requirement.OWN,
                        violation,
                        f"{name} (your own): cannot be met together with the rest, "
                        f"which breaks its bounds by {violation:.3g}",
                    )
        return IkFailure(
            Requirement.OWN,
            np.nan,
            f"{', '.join(names)} (your own): cannot be met together with the rest",
        )


def solve_from(
    scene: PlanningScene, target: HandTarget, start: Vector
) -> Vector | None:
    """Solve for a posture near `start` that reaches `target`; ignore collisions.

    Args:
        scene: The arm.
        target: Target of the hand.
        start: The only start, shape (N,) [rad].

    Returns:
        The posture, shape (N,) [rad]; None if none is found from there.
    """
    limits = (scene.lower + JOINT_MARGIN, scene.upper - JOINT_MARGIN)
    q, solved, _ = _Program(scene, target, limits).solve(start, start)
    return q if solved else None


def _starts(
    limits: tuple[Vector, Vector], guess: Vector, rng: Generator, count: int
) -> Iterator[Vector]:
    """Yield the guess, then random postures farther and farther from it."""
    guess = np.clip(guess, *limits)
    for share in np.linspace(0.0, 1.0, count):
        yield guess + share * (rng.uniform(*limits) - guess)


class _Program:
    """One inverse kinematics program; a soft target is a cost, not a constraint."""

    def __init__(
        self,
        scene: PlanningScene,
        target: HandTarget,
        limits: tuple[Vector, Vector],
        *,
        soft_position: bool = False,
        soft_rotation: bool = False,
        extend: Extend | None = None,
    ) -> None:
        self._scene, self._soft = scene, soft_position or soft_rotation
        world, hand = scene.plant.world_frame(), scene.hand_frame
        ik = InverseKinematics(scene.plant, scene.context, with_joint_limits=False)
        self._ik, self._prog = ik, ik.get_mutable_prog()
        lower = scene.positions(limits[0])
        upper = scene.positions(limits[1])  # equal, except for the arm
        self._prog.AddBoundingBoxConstraint(lower, upper, ik.q())
        # A soft program seeks the least violation in any posture.
        weight = 1e-6 if self._soft else 1.0
        self._weights = weight * np.eye(scene.num_joints)
        fine = any(axis.angle < _SMALL_ANGLE for axis in target.axes)
        self._options = _FINE if fine else _OPTIONS

        tolerance = np.full(3, target.position_tolerance)
        if soft_position:
            ik.AddPositionCost(world, target.p_WT, hand, target.p_GT, np.eye(3))
        else:
            ik.AddPositionConstraint(
                hand, target.p_GT, world, target.p_WT - tolerance,
                target.p_WT + tolerance,
            )  # fmt: skip
        if not soft_position:
            self._AddRotation(target, soft_rotation)
        self.own: list[Binding] = []  # the caller's constraints
        self._own_costs: list[Binding] = []
        if extend is not None:
            self._extend(extend)

    def _extend(self, extend: Extend) -> None:
        programs = (self._prog.GetAllConstraints(), self._prog.GetAllCosts())
        before = {b.evaluator() for bindings in programs for b in bindings}
        extend(self._ik)
        self.own, self._own_costs = (
            [b for b in bindings if b.evaluator() not in before]
            for bindings in (self._prog.GetAllConstraints(), self._prog.GetAllCosts())
        )

    def _AddRotation(self, target: HandTarget, soft_rotation: bool) -> None:
        ik, hand = self._ik, self._scene.hand_frame
        world = self._scene.plant.world_frame()
        if target.R_WG is not None:
            pair = (hand, RotationMatrix(), world, target.R_WG)
            if soft_rotation:
                ik.AddOrientationCost(*pair, 1.0)
            else:
                ik.AddOrientationConstraint(*pair, target.angle_tolerance)
        for axis in target.axes:
            vectors = (hand, axis.axis_G, world, axis.direction_W)
            if soft_rotation:
                ik.AddAngleBetweenVectorsCost(*vectors, 1.0)
            elif axis.angle >= _SMALL_ANGLE:
                ik.AddAngleBetweenVectorsConstraint(*vectors, 0.0, axis.angle)
            else:
                R = RotationMatrix.MakeFromOneVector(axis.direction_W, 2).matrix()
                right, a = 0.5 * np.pi, axis.angle
                for vector_W, least, most in (
                    (R[:, 0], right - a, right + a),
                    (R[:, 1], right - a, right + a),
                    (R[:, 0] + R[:, 2], 0.0, right),  # not the opposite direction
                ):
                    ik.AddAngleBetweenVectorsConstraint(
                        hand, axis.axis_G, world, vector_W, least, most
                    )

    def solve_without(self, own: Binding, start: Vector) -> float | None:
        """Return the violation of one of `own` if all others are met, else None."""
        self._prog.RemoveConstraint(own)
        result = self._solve(start, start)
        self._prog.AddConstraint(own)
        if not result.is_success():
            return None
        value, evaluator = result.EvalBinding(own), own.evaluator()
        below, above = evaluator.lower_bound() - value, value - evaluator.upper_bound()
        return float(np.max([below, above]))

    def solve(self, start: Vector, pull: Vector) -> tuple[Vector, bool, float]:
        """Return the result from a start, drawn towards `pull`.

        Returns:
            q (N,), whether it is valid, and the caller's own costs.
        """
        result = self._solve(start, pull)
        own = sum(result.EvalBinding(cost).sum() for cost in self._own_costs)
        q_arm = self._ik.q()[self._scene.arm_indices]
        return result.GetSolution(q_arm), result.is_success(), float(own)

    def _solve(self, start: Vector, pull: Vector) -> MathematicalProgramResult:
        q_arm = self._ik.q()[self._scene.arm_indices]
        cost = self._prog.AddQuadraticErrorCost(self._weights, pull, q_arm)
        # Variables that the caller has added start at 0.
        guess = np.zeros(self._prog.num_vars())
        positions = self._scene.positions(start)
        guess[self._prog.FindDecisionVariableIndices(self._ik.q())] = positions
        result = SnoptSolver().Solve(self._prog, guess, self._options)
        self._prog.RemoveCost(cost)
        return result
