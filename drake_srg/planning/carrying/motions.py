"""The motions of two arms that carry an object together, planned as one.

Both hands hold the object, so arms and object are a closed chain. The object's path
X_WO(s) leads, and each hand follows it at a constant X_OG.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.trajectories import Trajectory

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.planning.grasps.grasps import SUPPORT_OVERLAP, Grasp, Hand
from drake_srg.planning.grasps.srg_hand import Approach, SrgGrasp
from drake_srg.planning.motion.arm_pair import (
    ArmPair,
    minimum_jerk_motion,
    together,
)
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.paths import plan_cartesian_path
from drake_srg.planning.motion.planning_scene import (
    NoPathError,
    PlanningFailure,
    most_specific,
)
from drake_srg.planning.pick_and_place.task_motions import (
    Obstacles,
    TaskMotions,
    TaskPlanner,
)
from drake_srg.types import AnyMode, Box, Failure, Mode, Vector

# Steps of the object's path, of its origin and of its turn [m], [rad].
_STEP, _TURN = 0.02, 0.05
_LEAST_STEPS = 4  # of a path, however short
_UP = np.array([0.0, 0.0, 1.0])
_FIRMER = 1.5  # factor on the squeeze once a grasp has failed
# How much farther a wall reaches into the hand than other things do [m]. Other things
# end 2 mm beyond the base links, whose sensors just see their edge. A heavy crate
# creeps by up to 2 mm in the hands. If a base link lost the edge, Algorithm 1 would
# send it to the whole command, and the grip would jump by some millimetres.
_DEEPER = 0.005


@dc.dataclass(frozen=True)
class EndWall:
    """A wall at an end of an object that a hand may take from above.

    Attributes:
        X_OE: Its middle in the object, x across the wall [m].
        box: Its shape; x is the thickness.
    """

    X_OE: RigidTransform
    box: Box

    def grasps(self, hand: Hand, firmness: float = 1.0) -> list[SrgGrasp]:
        """Return the pinches from above across the wall, with X_GO equal to X_GE."""
        across = np.array([1.0, 0.0, 0.0])
        return [
            dc.replace(grasp, p_GO=grasp.p_GO - np.array([_DEEPER, 0.0, 0.0]))
            for grasp in hand.grasps(self.box, RigidTransform(), firmness)
            if isinstance(grasp, SrgGrasp)
            and grasp.approach is Approach.ABOVE
            and grasp.across_O is not None
            and abs(grasp.across_O @ across) > 0.5
        ]


def end_walls(solid: Solid) -> tuple[EndWall, EndWall] | None:
    """Return the walls at both ends of a solid along its x; None if it has none.

    They are the convex pieces whose centers are farthest along -x and x, if these are
    boxes along the axes, rise to the top and are equally thick.
    """
    if not isinstance(solid, ConvexPieces) or len(solid.pieces) < 2:
        return None
    centers = [0.5 * (p.min(axis=0) + p.max(axis=0)) for p in solid.pieces]
    order = sorted(range(len(centers)), key=lambda i: float(centers[i][0]))
    walls = []
    top = solid.half_extent(_UP)
    for i in (order[0], order[-1]):
        size = np.ptp(solid.pieces[i], axis=0)
        a_box = np.allclose(np.abs(solid.pieces[i] - centers[i]), 0.5 * size, atol=1e-6)
        if not a_box or solid.pieces[i][:, 2].max() < top - 1e-6:
            return None
        walls.append(EndWall(RigidTransform(centers[i]), Box(size.tolist())))
    first, second = (wall.box.size[0] for wall in walls)
    return (walls[0], walls[1]) if abs(first - second) < 1e-4 else None


@dc.dataclass(frozen=True, kw_only=True)
class PairGrasp(SrgGrasp):
    """A grasp of an object by two hands, each at its own place.

    Angles, closures and sensors are those of either hand; `p_GO` and `axis_G` are those
    of the first one.
    """

    X_GOs: tuple[RigidTransform, RigidTransform]  # the object in each hand [m]

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether both hands hold the object.

        Args:
            q: Measured angles of both grippers' joints, shape (2n,) [rad].
            proximity: Readings of both grippers' sensors, shape (2m,) [m].
        """
        hands = zip(np.split(q, 2), np.split(proximity, 2), strict=True)
        return all(super(PairGrasp, self).holds(*hand) for hand in hands)

    def X_WGs(self, X_WO: RigidTransform) -> tuple[RigidTransform, RigidTransform]:
        """Return the poses of the hands that hold the object at `X_WO` [m]."""
        first, second = self.X_GOs
        return X_WO @ first.inverse(), X_WO @ second.inverse()


def pair_grasp(grasp: Grasp) -> PairGrasp:
    """Return a grasp, cast to a grasp of two hands."""
    assert isinstance(grasp, PairGrasp)
    return grasp


class CarryTaskPlanner(TaskPlanner):
    """Plans all motions of two arms that carry an object together.

    A posture is that of both arms, shape (2N,) [rad], and every motion moves both.

    Args:
        planners: Plan for each arm alone.
        pair: The arms.
        config: Distances and speeds.
    """

    def __init__(
        self,
        planners: tuple[TaskPlanner, TaskPlanner],
        pair: ArmPair,
        config: CarryTogether,
    ) -> None:
        first, second = planners
        super().__init__(first.scene, first.hand, first.q_home, config)
        self.q_home = np.concatenate([first.q_home, second.q_home])
        self.planners = planners
        self.pair = pair
        self._press = config.press_depth
        self._both_moves = [Moves(p.scene, p.hand.p_GT, config) for p in planners]

    def X_WG(self, q: Vector) -> RigidTransform:
        """Return the first hand's pose [m] with both arms at `q` (2N,) [rad]."""
        return self.X_WGs(q)[0]

    def X_WGs(self, q: Vector) -> tuple[RigidTransform, RigidTransform]:
        """Return the hands' poses [m] with both arms at `q` (2N,) [rad]."""
        first, second = (
            arm.scene.X_WG(half)
            for arm, half in zip(self.pair.arms, np.split(q, 2), strict=True)
        )
        return first, second

    def regrasped(self, grasp: PairGrasp, q: Vector, X_WO: RigidTransform) -> PairGrasp:
        """Return a grasp, updated to the hands with both arms at `q` (2N,) [rad]."""
        first, second = (X_WG.inverse() @ X_WO for X_WG in self.X_WGs(q))
        return dc.replace(
            grasp,
            p_GO=first.translation(),
            axis_G=first.rotation().col(2),
            X_GOs=(first, second),
        )

    def _escape(
        self, q: Vector, fingers: Mapping[str, float]
    ) -> tuple[Trajectory, Trajectory]:
        """Return the motions of both hands out of a failed grasp, and home."""
        self._set_fingers(fingers)
        paths = list[Vector]()
        for i, half in enumerate(np.split(q, 2)):
            moves, scene = self._both_moves[i], self.pair.arms[i].scene
            path = plan_cartesian_path(scene, half, moves.behind(half))
            if isinstance(path, PlanningFailure):
                path = half[np.newaxis]
            paths.append(path)
        return self._timed(paths), self._home([path[-1] for path in paths])

    def rests(self, shape: Solid, X_WO: RigidTransform) -> bool:
        """Return whether an object at `X_WO` [m] has support and penetrates nothing."""
        return self.planners[0].rests(shape, X_WO)

    def others(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles
    ) -> Obstacles:
        """Return the obstacles that are not views of either arm."""
        for planner, half in zip(self.planners, np.split(q, 2), strict=True):
            obstacles = planner.others(half, fingers, obstacles)
        return obstacles

    @contextlib.contextmanager
    def ready(self, obstacles: Obstacles) -> Iterator[None]:
        """Add obstacles to both scenes; restore everything that a plan changes."""
        fingers = [arm.scene.fingers for arm in self.pair.arms]
        homes = np.split(self.q_home, 2)
        try:
            with contextlib.ExitStack() as stack:
                for i, planner in enumerate(self.planners):
                    stack.enter_context(planner.standing(obstacles))
                    stack.enter_context(self.pair.beside(i, homes[1 - i], {}))
                yield
        finally:
            for arm, angles in zip(self.pair.arms, fingers, strict=True):
                arm.scene.fingers = angles

    def _set_fingers(self, angles: Mapping[str, float]) -> None:
        for arm in self.pair.arms:
            arm.scene.SetFingers(angles)

    def _backs(self, q: Vector) -> list[Vector]:
        """Return the paths of both hands, drawn back from a posture (2N,) [rad]."""
        halves = zip(self._both_moves, np.split(q, 2), strict=True)
        return [moves.straight(half, moves.behind(half)) for moves, half in halves]

    def _timed(self, paths: Sequence[Vector], *, straight: bool = False) -> Trajectory:
        """Return the motion of both arms with empty hands along a path of each."""
        each = zip(self._both_moves, paths, strict=True)
        return together([m.timed(path, m.free, straight=straight) for m, path in each])

    @contextlib.contextmanager
    def _standing(
        self, shape: Solid, X_WO: RigidTransform, *, touchable: bool
    ) -> Iterator[None]:
        with contextlib.ExitStack() as stack:
            for arm in self.pair.arms:
                standing = arm.scene.standing(shape, X_WO, touchable=touchable)
                stack.enter_context(standing)
            yield

    def _plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        tried: Sequence[str],
    ) -> TaskMotions:
        """Return the motions with the cheapest feasible pair of grasps.

        The object must have end walls; for its goal, see `aligned`.
        """
        taken = self.planners[0]._overlap(shape, X_WO_goal)
        if taken is not None:
            message = f"the goal is taken: {taken}"
            raise NoPathError(PlanningFailure(Failure.BLOCKED, message))
        walls = end_walls(shape)
        assert walls is not None, "checked where the planner is built"
        bases = [arm.scene.p_WA for arm in self.pair.arms]
        ends = [X_WO @ wall.X_OE.translation() for wall in walls]
        swapped = _apart(bases, ends) > _apart(bases, ends[::-1])
        firmness = _FIRMER if tried else 1.0
        choices = [
            self._grips(i, wall, X_WO, shape, firmness)
            for i, wall in enumerate(walls[::-1] if swapped else walls)
        ]
        failures: list[PlanningFailure] = []
        pairs = itertools.product(*choices)
        for first, second in sorted(pairs, key=lambda p: p[0].cost + p[1].cost):
            held = (first.X_GO, second.X_GO)
            grasp = PairGrasp(**vars(first.grasp), X_GOs=held)
            q_pick = np.concatenate([first.q, second.q])
            # Inverse kinematics has tolerances; the closed chain has none.
            grasp = self.regrasped(grasp, q_pick, X_WO)
            try:
                reach = self._reach(q_start, q_pick, grasp, shape, X_WO)
                carry = self._carry(q_pick, grasp, shape, X_WO_goal)
                return TaskMotions(grasp, {**reach, **carry})
            except NoPathError as error:
                failures.append(error.failure)
        raise NoPathError(most_specific(failures))

    def _grips(
        self,
        index: int,
        wall: EndWall,
        X_WO: RigidTransform,
        shape: Solid,
        firmness: float,
    ) -> list[_Grip]:
        """Return the grasps of a wall by one arm."""
        arm, planner = self.pair.arms[index], self.planners[index]
        found, failures = list[_Grip](), list[IkFailure]()
        for grasp in wall.grasps(planner.hand, firmness):
            X_GO = grasp.X_GO @ wall.X_OE.inverse()
            arm.scene.SetFingers(grasp.fingers_open)
            with arm.scene.standing(shape, X_WO, touchable=True):
                pick = solve_inverse_kinematics(
                    arm.scene,
                    HandTarget.from_pose(X_WO @ X_GO.inverse()),
                    q_nominal=planner.q_home,
                )
            if isinstance(pick, IkFailure):
                failures.append(pick)
            else:
                found.append(_Grip(grasp, X_GO, pick.q, pick.cost))
        if found:
            return found
        if not failures:
            why = f"no known grasp fits an end wall of a {shape}"
            raise NoPathError(PlanningFailure(Failure.NO_GRASP, why))
        nearest = min(failures, key=lambda failure: failure.violation)
        message = f"{arm.name}, pick: {nearest.message}"
        raise NoPathError(PlanningFailure(nearest.failure, message))

    def _reach(
        self,
        q_start: Vector,
        q_pick: Vector,
        grasp: PairGrasp,
        shape: Solid,
        X_WO: RigidTransform,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions to the end walls."""
        self._set_fingers(grasp.fingers_open)
        with self._standing(shape, X_WO, touchable=True):
            backs = self._backs(q_pick)
            down = self._timed([back[::-1] for back in backs], straight=True)
            self.pair.checked(down, "grasp")
        with self._standing(shape, X_WO, touchable=False):
            starts = np.split(q_start, 2)
            paths = [
                moves.joint_path(starts[i], backs[i][-1])
                for i, moves in enumerate(self._both_moves)
            ]
            approach = self.pair.checked(self._timed(paths), "pre_grasp")
        return {Mode.PRE_GRASP: approach, Mode.GRASP: down}

    def _carry(
        self, q_grasp: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions that follow a grasp, from lifting to home."""
        grasp = pair_grasp(grasp)
        X_WO = self.X_WG(q_grasp) @ grasp.X_GOs[0]
        lift = self.config.lift_height
        goal = aligned(X_WO_goal, X_WO)
        up, above = raised(X_WO, lift), raised(goal, lift)
        with self._carrying(grasp, shape, SUPPORT_OVERLAP):
            lifting, q = self._carried(q_grasp, grasp, X_WO, up, "lift")
        with self._carrying(grasp, shape):
            across, q = self._carried(q, grasp, up, above, "transfer")
        placing = self._set_down(q, grasp, shape, above, goal)
        return {Mode.LIFT: lifting, Mode.TRANSFER: across, **placing}

    def _place(
        self, q_start: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions from above the goal onto it, and home."""
        grasp = pair_grasp(grasp)
        X_WO = self.X_WG(q_start) @ grasp.X_GOs[0]
        return self._set_down(q_start, grasp, shape, X_WO, aligned(X_WO_goal, X_WO))

    def _set_down(
        self,
        q_start: Vector,
        grasp: PairGrasp,
        shape: Solid,
        X_WO: RigidTransform,
        X_WO_goal: RigidTransform,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions that take the object from a pose to its goal, and home."""
        pressed = raised(X_WO_goal, -self._press)
        with self._carrying(grasp, shape, SUPPORT_OVERLAP - self._press):
            placing, q_place = self._carried(q_start, grasp, X_WO, pressed, "place")
        self._set_fingers(grasp.fingers_open)
        with self._standing(shape, X_WO_goal, touchable=True):
            backs = self._backs(q_place)
            away = self.pair.checked(self._timed(backs, straight=True), "retreat")
        with self._standing(shape, X_WO_goal, touchable=False):
            home = self._home([path[-1] for path in backs])
        return {Mode.PLACE: placing, Mode.RETREAT: away, Mode.HOME: home}

    def _home(self, starts: Sequence[Vector]) -> Trajectory:
        """Return the motion of both arms home."""
        homes = np.split(self.q_home, 2)
        paths = [
            moves.joint_path(starts[i], homes[i])
            for i, moves in enumerate(self._both_moves)
        ]
        return self.pair.checked(self._timed(paths), "home")

    @contextlib.contextmanager
    def _carrying(
        self, grasp: PairGrasp, shape: Solid, margin: float | None = None
    ) -> Iterator[None]:
        """Let both hands hold the object; only the first hand's scene knows its shape.

        Args:
            grasp: The grasp of both hands.
            shape: The object's.
            margin: Distance that the object keeps from furniture [m]; None: the hands'.
        """
        self._set_fingers(grasp.fingers_closed)
        first, second = self.pair.arms
        with (
            first.scene.holding(shape, grasp.X_GOs[0], margin=margin),
            first.scene.shared_with(second.gripper),
        ):
            yield

    def _carried(
        self,
        q: Vector,
        grasp: PairGrasp,
        X_WO: RigidTransform,
        X_WO_end: RigidTransform,
        what: str,
    ) -> tuple[Trajectory, Vector]:
        """Return the motion along a straight line of the object, and its end.

        Args:
            q: Positions of both arms, shape (2N,) [rad].
            grasp: The grasp of both hands.
            X_WO: The object's pose at `q` [m].
            X_WO_end: Pose of the object at the end [m].
            what: Name of the motion, for messages.
        """
        poses = object_path(X_WO, X_WO_end)
        path = self.pair.follow(q, [grasp.X_WGs(X_WO) for X_WO in poses], what)
        limits = [moves.holding for moves in self._both_moves]
        motion = minimum_jerk_motion(path, limits)
        return self.pair.checked(motion, what), path[-1]


@dc.dataclass(frozen=True)
class _Grip:
    """A grasp of one wall by one arm."""

    grasp: SrgGrasp
    X_GO: RigidTransform
    q: Vector
    cost: float


def _apart(points: Sequence[Vector], others: Sequence[Vector]) -> float:
    return sum(
        float(np.linalg.norm(p - q)) for p, q in zip(points, others, strict=True)
    )


def raised(X: RigidTransform, height: float) -> RigidTransform:
    """Return a pose, moved upwards [m]."""
    return RigidTransform(X.rotation(), X.translation() + height * _UP)


def aligned(X_WO_goal: RigidTransform, X_WO: RigidTransform) -> RigidTransform:
    """Return the goal of an object at `X_WO` [m], upright, its x parallel to world x.

    Of both directions of its x, it is the one that turns the object less.
    """
    left = X_WO.rotation().matrix()[0, 0] < 0.0
    turn = RotationMatrix.MakeZRotation(np.pi if left else 0.0)
    return RigidTransform(turn, X_WO_goal.translation())


def object_path(start: RigidTransform, end: RigidTransform) -> list[RigidTransform]:
    """Return poses on a straight line, without the first one [m].

    The orientation turns evenly about one axis. All steps are equal.
    """
    turn = (start.rotation().inverse() @ end.rotation()).ToAngleAxis()
    shift = end.translation() - start.translation()
    steps = max(np.linalg.norm(shift) / _STEP, abs(turn.angle()) / _TURN)
    count = max(int(np.ceil(steps)), _LEAST_STEPS)
    return [
        RigidTransform(
            start.rotation()
            @ RotationMatrix(AngleAxis(share * turn.angle(), turn.axis())),
            start.translation() + share * shift,
        )
        for share in np.linspace(0.0, 1.0, count + 1)[1:]
    ]
