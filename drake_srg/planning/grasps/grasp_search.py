"""Search for grasps that the arm reaches at the object and at its goal."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator, Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.planning.grasps.grasps import PALM_Y, Grasp, Hand
from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Sphere, Vector

_UP = np.array([0.0, 0.0, 1.0])
# A held object may overlap its support by this much in the plan [m], because the plan
# has it stand on the support.
SUPPORT_OVERLAP = -0.003
# Directions about its axis from which an object is approached if the nearest one is
# blocked. Each stands for a sector of 45 degrees.
_TURNS = 8
# Cost of each failure of a grasp [rad²]. On the kitchen's table, a grasp from the side
# costs 16 to 30 more than one from above. So another look and a firmer hand come first,
# and another grasp after that.
_FAILED = 15.0


@dc.dataclass(frozen=True)
class Candidate:
    """A grasp with the arm's postures at both ends."""

    grasp: Grasp
    X_WO: RigidTransform  # of the object, with the end up that the grasp needs
    q_grasp: Vector  # shape (N,) [rad]
    q_place: Vector  # shape (N,) [rad]
    score: float  # lower is better


class GraspSearch:
    """Searches for grasps with a planning scene. Keeps nothing between calls.

    Args:
        scene: The arm, the gripper and what they may hit.
        hand: How that gripper takes objects.
        q_home: Home posture of the arm, shape (N,) [rad].
        place_height: Height above the goal at which the hand lets go [m].
        regrasp_squeeze: How much more firmly the hand closes once a grasp has failed.
    """

    def __init__(
        self,
        scene: PlanningScene,
        hand: Hand,
        q_home: Vector,
        *,
        place_height: float,
        regrasp_squeeze: float,
    ) -> None:
        self._scene = scene
        self._hand = hand
        self._q_home = q_home
        self._place_height = place_height
        self._regrasp_squeeze = regrasp_squeeze

    def candidates(
        self,
        X_WO_seen: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        *,
        turned: bool = False,
        tried: Sequence[str] = (),
    ) -> tuple[list[Candidate], list[PlanningFailure]]:
        """Return the grasps that the arm reaches at both ends, the best first.

        Args:
            X_WO_seen: The object's pose [m]; a round one's turn does not count.
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
        firmness = self._regrasp_squeeze if tried else 1.0
        choices = [
            (X_WO, grasp, target)
            for X_WO in self._ends_up(X_WO_seen, shape)
            for grasp in self._hand.grasps(shape, X_WO, firmness)
            for target in self._pick_targets(grasp, X_WO, turned)
        ]
        for X_WO, grasp, target in choices:
            self._scene.SetFingers(grasp.fingers_open)
            with self._scene.standing(shape, X_WO, touchable=True):
                pick = solve_inverse_kinematics(
                    self._scene, target, q_nominal=self._q_home
                )
            if isinstance(pick, IkFailure):
                no_pick.append((grasp, pick))
                continue
            place = self._place(pick.q, grasp, shape, X_WO_goal)
            if isinstance(place, IkFailure):
                no_place.append((grasp, place))
                continue
            # The cost is the distance of the joints from home [rad²]. Clearance counts
            # up to 5 cm, with 0.5 rad² per cm. A leaning hand tilts what it holds:
            # 5 degrees, which is 4 mm beside the goal, cost 3.5 rad².
            spare = min(
                0.05,
                *(s.clearance.distance for s in (pick, place) if s.clearance),
            )
            score = pick.cost + place.cost - 50.0 * spare + 40.0 * grasp.lean
            score += grasp.cost + _FAILED * tried.count(grasp.name)
            candidates.append(Candidate(grasp, X_WO, pick.q, place.q, score))
        # The narrowest miss, of angles or of distances, says most.
        step, missed = ("place", no_place) if no_place else ("pick", no_pick)
        failures = [
            PlanningFailure(ik.failure, f"{step} {grasp.name}: {ik.message}")
            for grasp, ik in sorted(missed, key=lambda miss: miss[1].violation)
        ]
        return sorted(candidates, key=lambda c: c.score), failures

    def grasped(
        self, q_grasp: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> Candidate:
        """Return the candidate of a grasp that holds its object.

        Args:
            q_grasp: Where the arm is, shape (N,) [rad].
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
        X_WO = self._scene.X_WG(q_grasp) @ grasp.X_GO
        return Candidate(grasp, X_WO, q_grasp, place.q, score=0.0)

    def _place(
        self, q_grasp: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> IkSolution | IkFailure:
        with carrying(self._scene, shape, grasp, supported=True):
            return solve_inverse_kinematics(
                self._scene,
                place_target(grasp, X_WO_goal, self._place_height),
                q_nominal=self._q_home,
                q_guess=q_grasp,
            )

    def _pick_targets(
        self, grasp: Grasp, X_WO: RigidTransform, turned: bool
    ) -> list[HandTarget]:
        target = grasp.pick_target(X_WO)
        if not turned:
            return [target]
        if not self._scene.reaches_any_pose or len(target.axes) > 1:
            return []  # neither the arm nor an object with faces leaves a choice
        angles = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
        across = [X_WO.rotation() @ [np.cos(a), np.sin(a), 0.0] for a in angles]
        turns = [AxisTarget(PALM_Y, y_W, np.pi / _TURNS) for y_W in across]
        return [dc.replace(target, axes=(*target.axes, turn)) for turn in turns]

    def _ends_up(self, X_WO: RigidTransform, shape: Solid) -> list[RigidTransform]:
        """Return the object's pose, with either end up if it does not stand."""
        if X_WO.rotation().col(2)[2] >= np.cos(self._hand.upright_within):
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
    """Return where the hand lets go.

    Args:
        grasp: Of the object.
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
        grasp: How the hand holds it.
        supported: Whether the object stands on something.
    """
    scene.SetFingers(grasp.fingers_closed)
    margin = SUPPORT_OVERLAP if supported else None
    with scene.holding(shape, grasp.X_GO, margin=margin):
        yield
