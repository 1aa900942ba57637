"""Planning models of grasps and hands, and the search for reachable grasps."""

from __future__ import annotations

import abc
import contextlib
import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    IkFailure,
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import (
    NoPathError,
    PlanningFailure,
    PlanningScene,
)
from drake_srg.types import Sphere, Vector

# In every grasp, the palm's y is perpendicular to the object's axis.
PALM_Y = np.array([0.0, 1.0, 0.0])
_DOWN = np.array([0.0, 0.0, -1.0])
_EXACT = 0.002  # tolerance of a direction [rad]


@dc.dataclass(frozen=True, kw_only=True)
class Grasp(abc.ABC):
    """A way to take an object, and to set it down with its axis upright.

    The axis is the object's z unless `axis_O` says otherwise.

    The rotation about the object's axis is free when the object is set down. When the
    object is taken, it is free unless `across_O` or `down_G` fixes it.
    """

    name: str  # a few words, for messages
    p_GO: Vector  # the object's origin in the hand, shape (3,) [m]
    axis_G: Vector  # the object's axis in the hand, shape (3,)
    axis_O: Vector = dc.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    closure_open: float  # the object passes between the fingers
    closure_closed: float  # the fingers press on the object
    fingers_open: Mapping[str, float]  # joint angles of the gripper by name [rad]
    fingers_closed: Mapping[str, float]  # the same, as expected when holding [rad]
    # Angle between the object's axis and the nearest axis of the palm [rad].
    lean: float = 0.0
    # Direction of the palm's y in the object, perpendicular to its axis, shape
    # (3,): the normal of a box's face. None: the object is round.
    across_O: Vector | None = None
    # Whether the goal also fixes the object's rotation about its axis.
    turn_counts: bool = False
    # Direction in the palm that must point down when the hand takes a lying
    # object, perpendicular to `axis_G` and the palm's y, shape (3,). None: the
    # object stands.
    down_G: Vector | None = None
    # Largest turn of the axis from `axis_G` when the hand closes [rad].
    pick_angle: float = _EXACT
    # Motion of the object at the release, in the palm's axes, shape (3,) [m].
    release_shift_G: Vector = dc.field(default_factory=lambda: np.zeros(3))
    cost: float = 0.0  # added to the score; less is better [rad²]

    @property
    def X_GO(self) -> RigidTransform:
        """The object's pose in the hand [m]; a round one has an arbitrary rotation."""
        if self.across_O is None:
            return pose_along(self.p_GO, self.axis_G)
        R_GA = _axes(self.axis_G, PALM_Y)
        R_OA = _axes(self.axis_O, self.across_O)
        return RigidTransform(R_GA @ R_OA.inverse(), self.p_GO)

    def target(
        self, X_WO: RigidTransform, angle_tolerance: float = _EXACT
    ) -> HandTarget:
        """Return the hand's target for holding the object at `X_WO`.

        Args:
            X_WO: The object's pose in world [m]. Its rotation about its axis is ignored
                unless `turn_counts`.
            angle_tolerance: Tolerance of the angle of the object's axis in the hand
                [rad].
        """
        axis_W = X_WO.rotation().matrix() @ self.axis_O
        axes = [AxisTarget(self.axis_G, axis_W, angle_tolerance)]
        if self.turn_counts and self.across_O is not None:
            axes.append(AxisTarget(PALM_Y, X_WO.rotation() @ self.across_O, _EXACT))
        return HandTarget(p_WT=X_WO.translation(), p_GT=self.p_GO, axes=tuple(axes))

    def pick_target(self, X_WO: RigidTransform) -> HandTarget:
        """Return the hand's target for taking the object at `X_WO`.

        Unlike `target`, it respects the object's faces, and may let the closing hand
        turn the object.
        """
        target = self.target(X_WO, self.pick_angle)
        if self.down_G is not None:
            axis = AxisTarget(self.down_G, _DOWN, _EXACT)
        elif self.across_O is not None and not self.turn_counts:
            axis = AxisTarget(PALM_Y, X_WO.rotation() @ self.across_O, _EXACT)
        else:
            return target
        return dc.replace(target, axes=(*target.axes, axis))

    def set_down(
        self, X_WG: RigidTransform, X_WO_goal: RigidTransform
    ) -> RigidTransform:
        """Return the pose of the object once the hand has set it down on its goal [m].

        Args:
            X_WG: Pose of the hand [m].
            X_WO_goal: The goal [m]. The hand determines the rotation of an object with
                faces about its axis.
        """
        if self.across_O is None:
            return X_WO_goal
        R_WO = X_WG.rotation() @ self.X_GO.rotation()
        return RigidTransform(R_WO, X_WO_goal.translation())

    @abc.abstractmethod
    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether what the fingers sense may be the object, by its size.

        Args:
            q: Measured angles of the gripper's joints, shape (n,) [rad].
            proximity: Readings of its sensors, shape (m,) [m].
        """


@dc.dataclass(frozen=True, kw_only=True)
class PinchGrasp(Grasp):
    """A grasp between the pads of fingers whose angles reveal the held width."""

    fingers: Fingers
    width: float  # between the pads [m]

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether what the fingers sense has about its width."""
        return self.fingers.holds(self.width, q, proximity)


class Hand(abc.ABC):
    """A gripper as planning models it.

    Attributes:
        num_joints: Number n of measured joint angles.
        num_sensors: Number m of proximity readings.
        p_GT: The point of the hand that moves along straight lines, shape (3,) [m].
        upright_within: Lean up to which an object counts as standing upright [rad].
        pinch: Its fingers for pinches from above; None: the planner plans none.
    """

    num_joints: int
    num_sensors: int
    p_GT: Vector
    upright_within: float
    pinch: Fingers | None = None

    @abc.abstractmethod
    def grasps(
        self, shape: Solid, X_WO: RigidTransform, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the ways to take an object; empty if it does not fit the hand.

        Args:
            shape: The object's.
            X_WO: Its pose [m]. A round object's rotation about its axis is ignored.
            firmness: Factor on the usual squeeze, if the hand can vary it.
        """


def _axes(z: Vector, y: Vector) -> RotationMatrix:
    """Return the rotation of a frame with a given z axis, and y nearest to `y`."""
    z = z / np.linalg.norm(z)
    x = np.cross(y, z)
    x = x / np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z]))


def pose_along(p: Vector, axis: Vector) -> RigidTransform:
    """Return a pose whose z points along an axis.

    Its y is level if possible. The rotation about the axis is otherwise arbitrary.

    Args:
        p: Its position, shape (3,) [m].
        axis: Direction of the axis, of any length, shape (3,).
    """
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0], z)
    if np.linalg.norm(x) < 1e-6:
        x = np.array([1.0, 0.0, 0.0])
    x = x / np.linalg.norm(x)
    R = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R, np.asarray(p, dtype=float))


_UP = np.array([0.0, 0.0, 1.0])
# A held object may overlap its support by this much in the plan [m], because it stands
# on the support there.
SUPPORT_OVERLAP = -0.003
# Directions about its axis from which an object is approached if the nearest one is
# blocked. Each stands for a sector of 45 degrees.
_TURNS = 8
# Cost of each failure of a grasp [rad²]. On the kitchen's table, a grasp from the side
# costs 16 to 30 more than one from above. So the planner first looks again and grips
# more firmly, and only then tries another grasp.
_FAILED = 15.0
# Factor on the squeeze once a grasp has failed: about 21 N per finger in place of 14 N.
_REGRASP_SQUEEZE = 1.5


@dc.dataclass(frozen=True)
class Candidate:
    """A grasp with the arm's postures at the pick and at the place."""

    grasp: Grasp
    X_WO: RigidTransform  # of the object, with the grasp's end up
    q_grasp: Vector  # shape (N,) [rad]
    q_place: Vector  # shape (N,) [rad]
    score: float  # lower is better


@dc.dataclass(frozen=True)
class GraspSearch:
    """Searches for grasps in a planning scene; keeps no state between calls.

    Args:
        scene: The arm, the gripper and their surroundings.
        hand: The grasps of that gripper.
        q_home: Home posture of the arm, shape (N,) [rad].
        place_height: Height above the goal at which the hand lets go [m].
    """

    scene: PlanningScene
    hand: Hand
    q_home: Vector
    place_height: float

    def candidates(
        self,
        X_WO_seen: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        *,
        turned: bool = False,
        tried: Sequence[str] = (),
    ) -> tuple[list[Candidate], list[PlanningFailure]]:
        """Return the grasps that the arm reaches at both places, the best first.

        Args:
            X_WO_seen: The object's pose [m]. A round object's rotation about its axis
                is ignored.
            shape: Its shape.
            X_WO_goal: The goal's pose [m].
            turned: Whether to search each grasp from all around the object's axis,
                instead of only the posture nearest to home.
            tried: Names of grasps that failed. They cost more now, and every grasp is
                firmer.

        Returns:
            The candidates, and the reasons why other grasps are out of reach.
        """
        candidates: list[Candidate] = []
        no_pick: list[tuple[Grasp, IkFailure]] = []
        no_place: list[tuple[Grasp, IkFailure]] = []
        firmness = _REGRASP_SQUEEZE if tried else 1.0
        choices = [
            (X_WO, grasp, target)
            for X_WO in self._ends_up(X_WO_seen, shape)
            for grasp in self.hand.grasps(shape, X_WO, firmness)
            for target in self._pick_targets(grasp, X_WO, turned)
        ]
        for X_WO, grasp, target in choices:
            self.scene.SetFingers(grasp.fingers_open)
            with self.scene.standing(shape, X_WO, touchable=True):
                pick = solve_inverse_kinematics(
                    self.scene, target, q_nominal=self.q_home
                )
            if isinstance(pick, IkFailure):
                no_pick.append((grasp, pick))
                continue
            place = self._place(pick.q, grasp, shape, X_WO_goal)
            if isinstance(place, IkFailure):
                no_place.append((grasp, place))
                continue
            # The cost is the distance of the joints from home [rad²]. Clearance counts
            # up to 5 cm, with 0.5 rad² per cm. A leaning hand tilts the object: 5
            # degrees, which put it 4 mm beside the goal, cost 3.5 rad².
            spare = min(
                0.05,
                *(s.clearance.distance for s in (pick, place) if s.clearance),
            )
            score = pick.cost + place.cost - 50.0 * spare + 40.0 * grasp.lean
            score += grasp.cost + _FAILED * tried.count(grasp.name)
            candidates.append(Candidate(grasp, X_WO, pick.q, place.q, score))
        # The narrowest miss, in angle or distance, is the best explanation.
        step, missed = ("place", no_place) if no_place else ("pick", no_pick)
        failures = [
            PlanningFailure(
                ik.failure,
                f"{step} {grasp.name}: {ik.message}",
                picking=not no_place,
            )
            for grasp, ik in sorted(missed, key=lambda miss: miss[1].violation)
        ]
        return sorted(candidates, key=lambda c: c.score), failures

    def grasped(
        self, q_grasp: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> Candidate:
        """Return the candidate of a grasp that holds its object.

        Args:
            q_grasp: Posture of the arm, shape (N,) [rad].
            grasp: The grasp.
            shape: The object's shape.
            X_WO_goal: The goal's pose [m].

        Raises:
            NoPathError: If the arm does not reach the goal.
        """
        place = self._place(q_grasp, grasp, shape, X_WO_goal)
        if isinstance(place, IkFailure):
            message = f"place {grasp.name}: {place.message}"
            raise NoPathError(PlanningFailure(place.failure, message))
        X_WO = self.scene.X_WG(q_grasp) @ grasp.X_GO
        return Candidate(grasp, X_WO, q_grasp, place.q, score=0.0)

    def _place(
        self, q_grasp: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> IkSolution | IkFailure:
        with carrying(self.scene, shape, grasp, supported=True):
            return solve_inverse_kinematics(
                self.scene,
                place_target(grasp, X_WO_goal, self.place_height),
                q_nominal=self.q_home,
                q_guess=q_grasp,
            )

    def _pick_targets(
        self, grasp: Grasp, X_WO: RigidTransform, turned: bool
    ) -> list[HandTarget]:
        target = grasp.pick_target(X_WO)
        if not turned:
            return [target]
        if not self.scene.reaches_any_pose or len(target.axes) > 1:
            return []  # the arm or the object's faces leave no choice
        angles = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
        across = [X_WO.rotation() @ [np.cos(a), np.sin(a), 0.0] for a in angles]
        turns = [AxisTarget(PALM_Y, y_W, np.pi / _TURNS) for y_W in across]
        return [dc.replace(target, axes=(*target.axes, turn)) for turn in turns]

    def _ends_up(self, X_WO: RigidTransform, shape: Solid) -> list[RigidTransform]:
        """Return the object's pose; unless it stands, also with its other end up."""
        if X_WO.rotation().col(2)[2] >= np.cos(self.hand.upright_within):
            return [X_WO]
        if isinstance(shape, Sphere | ConvexPieces):
            return [X_WO]
        return [
            X_WO,
            X_WO @ RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0] * 3),
        ]


def place_target(
    grasp: Grasp, X_WO_goal: RigidTransform, height: float, **tolerance: float
) -> HandTarget:
    """Return the hand's target for the release.

    Args:
        grasp: Grasp of the object.
        X_WO_goal: The goal's pose [m].
        height: Above the goal [m].
        tolerance: Passed to `Grasp.target`.
    """
    released = dc.replace(grasp, p_GO=grasp.p_GO + grasp.release_shift_G)
    return released.target(X_WO_goal, **tolerance).shifted(height * _UP)


@contextlib.contextmanager
def carrying(
    scene: PlanningScene, shape: Solid, grasp: Grasp, *, supported: bool = False
) -> Iterator[None]:
    """Let the hand of a scene hold an object within the context.

    Args:
        scene: The planning scene.
        shape: The object's.
        grasp: The grasp that holds it.
        supported: Whether the object stands on something.
    """
    scene.SetFingers(grasp.fingers_closed)
    margin = SUPPORT_OVERLAP if supported else None
    with scene.holding(shape, grasp.X_GO, margin=margin):
        yield
