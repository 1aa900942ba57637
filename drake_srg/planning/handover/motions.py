"""The motions of a handover: to the meeting of the hands, and away from it."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.trajectories import Trajectory

from drake_srg.common.geometry import Solid
from drake_srg.planning.grasps.grasps import (
    PALM_Y,
    Grasp,
    Hand,
    carrying,
    place_target,
)
from drake_srg.planning.grasps.srg_hand import Approach, SrgGrasp
from drake_srg.planning.handover.config import Handover, HandoverMode
from drake_srg.planning.motion.arm_pair import ArmPair, stretched
from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import (
    NoPathError,
    PlanningFailure,
    PlanningScene,
    most_specific,
)
from drake_srg.planning.pick_and_place.task_motions import (
    Obstacles,
    TaskMotions,
    TaskPlanner,
)
from drake_srg.types import AnyMode, Failure, Mode, Vector

# Possible meeting points, for the object's centre: offsets towards the receiver, to the
# side, and upwards from the middle between the arms' first joints [m].
_MEETINGS = tuple(
    (along, aside, up)
    for up in (0.18, 0.24)
    for along, aside in ((0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (0.0, -0.1))
)
# The giver uses this much less of its pads than it could [m], which leaves more of the
# object to the receiver. The object also stays out of the 10 mm range of the base
# links' sensors: otherwise, one finger would stop before the other, and the object
# would lean.
_LESS = 0.01
_TURNS = 8  # sectors around the object from which the receiver may come
_UP = np.array([0.0, 0.0, 1.0])
GIVER, RECEIVER = 0, 1  # indices in the pair of arms


@dc.dataclass(frozen=True)
class HandoverMotions(TaskMotions):
    """The giver's grasp and motions, and the receiver's."""

    receiver: TaskMotions
    X_WO: RigidTransform  # of the object that is presented [m]


class GivingHand(Hand):
    """A hand that grasps standing objects only from above, by their upper ends."""

    def __init__(self, hand: Hand) -> None:
        self._hand = hand
        self.num_joints, self.num_sensors = hand.num_joints, hand.num_sensors
        self.p_GT, self.upright_within = hand.p_GT, hand.upright_within
        self.pinch = hand.pinch

    def grasps(
        self, shape: Solid, X_WO: RigidTransform, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the grasps from above that use less of the pads; see `Hand`."""
        found = self._hand.grasps(shape, X_WO, firmness)
        farther = np.array([_LESS, 0.0, 0.0])
        return [
            dc.replace(grasp, p_GO=grasp.p_GO + farther)
            for grasp in found
            if isinstance(grasp, SrgGrasp)
            and grasp.approach is Approach.ABOVE
            and not grasp.lean
        ]


# A pose in which an object lies; the hand then takes it across its axis.
_LYING = RigidTransform(RotationMatrix.MakeXRotation(0.5 * np.pi), [0.0, 0.0, 0.0])


def taking_grasps(hand: Hand, shape: Solid, height: float) -> list[SrgGrasp]:
    """Return pinches from the side at a height above the object's lower end.

    They are the pinches of a lying object, applied to one that is held upright.
    A wrap around a slim object presses with the ends of the fingers only, and slips.

    Args:
        hand: The receiver's.
        shape: The object's shape.
        height: Height at which the palm's x meets the object's axis [m].
    """
    from_origin = height - shape.half_extent(-_UP)
    return [
        dc.replace(
            grasp,
            name=f"from the side, {np.rad2deg(grasp.tilt):.0f} degrees down",
            p_GO=grasp.p_GO - from_origin * grasp.axis_G,
            down_G=None,
        )
        for grasp in hand.grasps(shape, _LYING)
        if isinstance(grasp, SrgGrasp) and grasp.across_O is None
    ]


class HandoverTaskPlanner(TaskPlanner):
    """Plans all motions of a handover; keeps no state between calls.

    For the modes of picking and placing, it is the giver's planner. Private methods
    raise `NoPathError` if there is no solution.

    Args:
        scene: The giver and its surroundings, including the receiver.
        hand: The giver's grasps.
        q_home: Home posture of the giver, shape (N,) [rad].
        config: Distances and speeds.
        receiver: Plans the receiver's motions, in a scene with the giver.
        pair: The scenes of the giver and of the receiver.
    """

    config: Handover

    def __init__(
        self,
        scene: PlanningScene,
        hand: Hand,
        q_home: Vector,
        config: Handover,
        receiver: TaskPlanner,
        pair: ArmPair,
    ) -> None:
        super().__init__(scene, hand, q_home, config)
        self.receiver = receiver
        self.pair = pair
        self._receiver_moves = Moves(receiver.scene, receiver.hand.p_GT, config)

    def plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
        tried: Sequence[str] = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan the whole handover, which begins and ends with both arms at home.

        Args:
            q_start: Posture of the giver, at rest, shape (N,) [rad].
            X_WO: The object's pose [m]. Its rotation about its axis is ignored.
            shape: The object's shape.
            X_WO_goal: Goal of the object [m].
            obstacles: Other objects and their poses [m].
            tried: Names of the giver's grasps that failed.
        """
        out_of_reach = self._no_goal(shape, X_WO_goal, obstacles)
        if out_of_reach is not None:
            return out_of_reach
        failures: list[PlanningFailure] = []
        q_waiting, waiting = self.receiver.q_home, self.waiting_fingers(shape)
        for X_WO_met in self.meetings():
            with self.pair.beside(GIVER, q_waiting, waiting):
                given = super().plan(q_start, X_WO, shape, X_WO_met, obstacles, tried)
            if isinstance(given, PlanningFailure):
                failures.append(given)
                if given.picking:
                    break
                continue
            try:
                return self._received(given, shape, X_WO_goal, obstacles)
            except NoPathError as error:
                failures.append(error.failure)
        return most_specific(failures)

    def waiting_fingers(self, shape: Solid) -> Mapping[str, float]:
        """Return the receiver's fingers, by name [rad], while it waits for an object.

        They are as open as the grasp needs. If they opened on the way, they would sweep
        unchecked space beside the giver.
        """
        height = self.config.grip_height
        grasps = taking_grasps(self.receiver.hand, shape, height)
        return min(grasps, key=lambda grasp: grasp.closure_open).fingers_open

    def _no_goal(
        self, shape: Solid, X_WO_goal: RigidTransform, obstacles: Obstacles
    ) -> PlanningFailure | None:
        """Return why the receiver cannot set the object down; None if it can."""
        receiver, failures = self.receiver, list[IkFailure]()
        for grasp in taking_grasps(receiver.hand, shape, self.config.grip_height):
            with (
                self.pair.beside(RECEIVER, self.q_home, {}),
                receiver.standing(obstacles),
                carrying(receiver.scene, shape, grasp, supported=True),
            ):
                found = solve_inverse_kinematics(
                    receiver.scene,
                    place_target(grasp, X_WO_goal, self.config.place_height),
                    q_nominal=receiver.q_home,
                )
            if not isinstance(found, IkFailure):
                return None
            failures.append(found)
        if not failures:
            why = f"the receiver knows no grasp from the side of a {shape}"
            return PlanningFailure(Failure.NO_GRASP, why)
        nearest = min(failures, key=lambda failure: failure.violation)
        message = f"the receiver cannot set it down: {nearest.message}"
        return PlanningFailure(nearest.failure, message)

    def meetings(self) -> list[RigidTransform]:
        """Return upright poses of the object in which it may change hands [m]."""
        p_WG, p_WR = self.scene.p_WA, self.receiver.scene.p_WA
        across = p_WR - p_WG
        along = across / np.linalg.norm(across)
        aside = np.cross(_UP, along)
        middle = 0.5 * (p_WG + p_WR)
        return [
            RigidTransform(middle + a * along + b * aside + c * _UP)
            for a, b, c in _MEETINGS
        ]

    def back(self, q: Vector, plan: HandoverMotions) -> Trajectory | PlanningFailure:
        """Plan from the end of the receiver's pull back to its start.

        Args:
            q: The receiver's posture, shape (N,) [rad].
            plan: Its motions.
        """
        start = plan.receiver.motions[HandoverMode.PULL].value(0.0)[:, 0]
        moves, line = self._receiver_moves, np.array([q, start])
        try:
            return moves.timed(line, moves.holding, straight=True)
        except NoPathError as error:
            return error.failure

    def _received(
        self,
        given: TaskMotions,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles,
    ) -> HandoverMotions:
        """Return the motions of both arms, given the giver's up to the meeting."""
        q_met = _end(given.motions[Mode.PLACE])
        X_WO = self.scene.X_WG(q_met) @ given.grasp.X_GO
        X_WO = RigidTransform(X_WO.translation())  # it is round
        height = self.config.grip_height
        grasps = taking_grasps(self.receiver.hand, shape, height)
        failures: list[PlanningFailure] = []
        for turn in (None, *np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)):
            for grasp in grasps:
                try:
                    return self._taken(
                        given, grasp, turn, shape, X_WO, X_WO_goal, obstacles
                    )
                except NoPathError as error:
                    failures.append(error.failure)
            # From another side, the hand may get past the giver, but not farther.
            if all(f.failure is not Failure.BLOCKED for f in failures):
                break
        raise NoPathError(most_specific(failures))

    def _taken(
        self,
        given: TaskMotions,
        grasp: SrgGrasp,
        turn: float | None,
        shape: Solid,
        X_WO: RigidTransform,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles,
    ) -> HandoverMotions:
        """Return the motions with one grasp of the receiver.

        Args:
            given: The giver's grasp and motions up to the meeting.
            grasp: The receiver's grasp.
            turn: Direction of the palm's y from the world's x [rad]; None: any.
            shape: The object's shape.
            X_WO: The object that is presented [m].
            X_WO_goal: Goal of the object [m].
            obstacles: Other objects and their poses [m].
        """
        q_met = _end(given.motions[Mode.PLACE])
        with self.pair.beside(RECEIVER, q_met, given.grasp.fingers_closed):
            motions, q_take = self._reach(grasp, turn, shape, X_WO, obstacles)
        taken = self.pair.beside(GIVER, q_take, grasp.fingers_closed)
        with taken, self.standing(obstacles):
            leaving = self.leave(q_met, given.grasp, shape, X_WO)
        leave: dict[AnyMode, Trajectory] = {
            HandoverMode.WITHDRAW: leaving[Mode.RETREAT],
            HandoverMode.CLEAR: leaving[Mode.HOME],
        }
        with self.pair.beside(RECEIVER, self.q_home, given.grasp.fingers_open):
            carry = self.receiver.plan_carry(q_take, grasp, shape, X_WO_goal, obstacles)
        if isinstance(carry, PlanningFailure):
            raise NoPathError(carry)
        received = TaskMotions(grasp, {**carry.motions, **motions})
        return HandoverMotions(given.grasp, {**given.motions, **leave}, received, X_WO)

    def _reach(
        self,
        grasp: Grasp,
        turn: float | None,
        shape: Solid,
        X_WO: RigidTransform,
        obstacles: Obstacles,
    ) -> tuple[dict[AnyMode, Trajectory], Vector]:
        """Return the receiver's motions up to its pull, and its grasping posture."""
        receiver, moves = self.receiver, self._receiver_moves
        scene, distance = receiver.scene, self.config.pull_distance
        with receiver.ready(obstacles):
            scene.SetFingers(grasp.fingers_open)
            with scene.standing(shape, X_WO, touchable=True):
                q_take = self._posture(grasp.target(X_WO), turn)
                back = moves.straight(q_take, moves.behind(q_take))
                down = HandTarget.from_pose(scene.X_WG(q_take)).shifted(-distance * _UP)
                pull = moves.straight(q_take, down)
            with scene.standing(shape, X_WO):
                approach = moves.joint_path(receiver.q_home, back[-1])
            slow = moves.timed(pull, moves.holding, straight=True)
            motions: dict[AnyMode, Trajectory] = {
                HandoverMode.APPROACH: moves.timed(approach, moves.free),
                HandoverMode.REACH: moves.timed(back[::-1], moves.free, straight=True),
                HandoverMode.PULL: stretched(slow, distance / self.config.pull_speed),
            }
        return motions, q_take

    def _posture(self, target: HandTarget, turn: float | None) -> Vector:
        """Return a collision-free posture of the receiver at a target; see `_taken`."""
        if turn is not None:
            y_W = np.array([np.cos(turn), np.sin(turn), 0.0])
            side = AxisTarget(PALM_Y, y_W, np.pi / _TURNS)
            target = dc.replace(target, axes=(*target.axes, side))
        q = solve_inverse_kinematics(
            self.receiver.scene, target, q_nominal=self.receiver.q_home
        )
        if isinstance(q, IkFailure):
            message = f"the receiver cannot take it: {q.message}"
            raise NoPathError(PlanningFailure(q.failure, message))
        return q.q


def _end(trajectory: Trajectory) -> Vector:
    q: Vector = trajectory.value(trajectory.end_time())[:, 0]
    return q
