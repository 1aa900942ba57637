"""What planning knows of the world: an arm, its gripper, and what they may hit."""

from __future__ import annotations

import contextlib
import copy
import dataclasses as dc
import logging
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from pydrake import geometry
from pydrake.common import Parallelism
from pydrake.math import RigidTransform
from pydrake.multibody.tree import (
    BodyIndex,
    Joint,
    ModelInstanceIndex,
    RigidBody,
    SpatialInertia,
)
from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker

from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

# How far fingers and held objects may reach from the hand's origin [m]; it only
# enters the step between checked configurations, never a distance.
_HAND_REACH = 0.2


@dc.dataclass(frozen=True)
class Clearance:
    """The pair of bodies that comes closest to breaking its margin."""

    distance: float  # signed distance [m]; inf where nothing is near
    margin: float  # the distance this pair has to keep [m]
    bodies: tuple[str, str]

    @property
    def spare(self) -> float:
        """Distance beyond the margin [m]; negative where the margin is broken."""
        return self.distance - self.margin

    def __str__(self) -> str:
        first, second = self.bodies
        return (
            f"{first} and {second} are {1e3 * self.distance:.1f} mm apart, "
            f"{1e3 * self.margin:.1f} mm are needed"
        )


class PlanningScene:
    """A collision checker that knows arm joints, fingers and the object at hand.

    Throughout, `q` is shape (N,) [rad]: the arm's one-degree-of-freedom joints in
    the order of the plant's positions. The fingers stand still at `fingers`. Frame G
    is the body `hand`, O an object's frame (see `drake_srg.types.Shape`), W the
    world. Every other joint of the plant stays at its default.

    Three distances are kept from the surroundings, each per pair of bodies: the arm
    `margin`, the gripper `hand_margin` (fingers work near tables), and a held object
    its own. Links of the arm keep clear of each other, without a margin. Bodies of
    the gripper may touch each other, what is held, and what is `touchable`.

    A held object touches its support when it is picked and placed. Give it a
    negative margin there, such as -0.003 m: that much overlap with furniture then
    counts as free. From what stands about it keeps the gripper's distance all the same.

    Between two configurations of a path, checks are so close that no point moves
    further than `step` from one to the next. The default is twice the smaller
    margin: between two checks nothing then comes closer than contact.
    """

    def __init__(
        self,
        builder: RobotDiagramBuilder,
        *,
        arm: str = "arm",
        gripper: str = "gripper",
        hand: str = "palm",
        margin: float = 0.01,
        hand_margin: float = 0.005,
        payload: float = 0.0,
        step: float | None = None,
    ) -> None:
        """Finishes `builder` and takes its diagram.

        Args:
            builder: holds arm, gripper and furniture, not finalized. No free bodies.
            arm: name of the arm's model instance.
            gripper: name of the gripper's model instance, welded to the arm.
            hand: name of the gripper's body G whose pose is planned.
            margin: distance the arm keeps from its surroundings [m].
            hand_margin: distance the gripper keeps from them [m].
            payload: mass at G's origin that torque limits allow for [kg]; always there.
            step: largest motion of any point between two checks [m].

        Raises:
            ValueError: if a margin or the step is negative, or the step zero.
            RuntimeError: (Drake's) if a name is unknown or the plant is finalized.
        """
        if margin < 0.0 or hand_margin < 0.0:
            raise ValueError("margin and hand_margin must not be negative.")
        self.step = step or 2.0 * min(margin, hand_margin)
        if self.step <= 0.0:
            raise ValueError("step must be positive, or left out with both margins.")
        plant = builder.plant()
        arm_model = plant.GetModelInstanceByName(arm)
        gripper_model = plant.GetModelInstanceByName(gripper)
        hand_frame = plant.GetFrameByName(hand, gripper_model)
        inertia = SpatialInertia.SolidSphereWithMass(max(payload, 1e-9), 0.03)
        held = plant.AddRigidBody("held_object", gripper_model, inertia)
        plant.WeldFrames(hand_frame, held.body_frame())
        others = plant.AddModelInstance("planning_obstacles")
        self._standing = plant.AddRigidBody("standing_object", others)
        self._obstacle = plant.AddRigidBody("obstacle", others)
        for body in (self._standing, self._obstacle):
            plant.WeldFrames(plant.world_frame(), body.body_frame())

        with _quiet():  # Drake announces its contexts at every construction
            self._checker = SceneGraphCollisionChecker(
                model=builder.Build(),
                robot_model_instances=[arm_model, gripper_model],
                edge_step_size=self.step,  # required; edges are walked here instead
                implicit_context_parallelism=Parallelism(1),
            )
        self.plant = self._checker.plant()
        self.context = self.plant.CreateDefaultContext()
        self.hand_frame = hand_frame
        self._held = held
        self._gripper_model = gripper_model
        self._positions = self.plant.GetPositions(self.context)
        joints = self._moving_joints(arm_model)
        self.joint_names = [joint.name() for joint in joints]
        self.finger_names = [
            joint.name() for joint in self._moving_joints(gripper_model)
        ]
        self.arm_indices = np.array([joint.position_start() for joint in joints])
        # A joint without limits gets two turns, so that postures can be drawn.
        turn = 2.0 * np.pi
        lower, upper = (
            self.plant.GetPositionLowerLimits(),
            self.plant.GetPositionUpperLimits(),
        )
        self.lower: Vector = np.maximum(lower[self.arm_indices], -turn)
        self.upper: Vector = np.minimum(upper[self.arm_indices], turn)

        gripper_bodies = [
            self.plant.get_body(index)
            for index in self.plant.GetBodyIndices(gripper_model)
        ]
        for i, body in enumerate(gripper_bodies):
            self._checker.SetCollisionFilteredBetween(body, self._standing, True)
            for other in gripper_bodies[:i]:
                self._checker.SetCollisionFilteredBetween(body, other, True)
        self._checker.SetPaddingAllRobotEnvironmentPairs(margin)
        for body in gripper_bodies:
            self._SetMargin(body.index(), hand_margin)
        self._hand_margin = hand_margin

        points = [
            joint.frame_on_child().CalcPoseInWorld(self.context).translation()
            for joint in joints
        ]
        points.append(hand_frame.CalcPoseInWorld(self.context).translation())
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        # No point moves further than levers @ abs(dq): the stretched chain from each
        # joint to the finger tips is its lever.
        self.levers: Vector = np.cumsum(lengths[::-1])[::-1] + _HAND_REACH

    def copy(self) -> PlanningScene:
        """Return a scene of the same model with a state of its own.

        That takes a tenth of the time that it takes to make one.
        """
        twin = copy.copy(self)
        twin._checker = self._checker.Clone()
        twin.plant = twin._checker.plant()
        twin.context = twin.plant.CreateDefaultContext()
        twin._positions = self._positions.copy()
        return twin

    def _moving_joints(self, model: ModelInstanceIndex) -> list[Joint]:
        joints = map(self.plant.get_joint, self.plant.GetJointIndices(model))
        moving = (joint for joint in joints if joint.num_positions() == 1)
        return sorted(moving, key=lambda joint: joint.position_start())

    def _SetMargin(self, body: BodyIndex, margin: float) -> None:
        self._checker.SetPaddingOneRobotBodyAllEnvironmentPairs(body, margin)

    @property
    def num_joints(self) -> int:
        """N, the number of arm joints."""
        return len(self.arm_indices)

    @property
    def fingers(self) -> Vector:
        """Angles of the gripper's joints in planning [rad], as `finger_names`."""
        return self.plant.GetPositionsFromArray(self._gripper_model, self._positions)

    @fingers.setter
    def fingers(self, value: Vector) -> None:
        self.plant.SetPositionsInArray(self._gripper_model, value, self._positions)

    def SetFingers(self, angles: Mapping[str, float]) -> None:
        """Set the gripper's joints by name [rad]; those left out go to 0.

        Raises:
            ValueError: if a name is not one of `finger_names`.
        """
        if unknown := set(angles) - set(self.finger_names):
            raise ValueError(
                f"the gripper has no joints {sorted(unknown)}; "
                f"allowed: {', '.join(self.finger_names)}"
            )
        self.fingers = np.array([angles.get(n, 0.0) for n in self.finger_names])

    def positions(self, q: Vector) -> Vector:
        """All positions of the plant, shape (num_positions,), with the arm at `q`."""
        positions = self._positions.copy()
        positions[self.arm_indices] = q
        return positions

    def X_WG(self, q: Vector) -> RigidTransform:
        """The hand's pose in world [m] with the arm at `q`."""
        self.plant.SetPositions(self.context, self.positions(q))
        return self.hand_frame.CalcPoseInWorld(self.context)

    def is_free(self, q: Vector) -> bool:
        """Whether every pair of bodies keeps its margin at `q`."""
        return self._checker.CheckConfigCollisionFree(self.positions(q))

    def clearance(self, q: Vector, influence: float = 0.05) -> Clearance:
        """The pair nearest to breaking its margin at `q`.

        Pairs further apart than `influence` [m] beyond their margin are not seen.
        """
        found = self._checker.CalcRobotClearance(self.positions(q), influence)
        if found.size() == 0:
            return Clearance(np.inf, 0.0, ("nothing", "nothing"))
        spares = found.distances()
        nearest = int(np.argmin(spares))
        pair = (found.robot_indices()[nearest], found.other_indices()[nearest])
        margin = float(self._checker.GetPaddingBetween(*pair))
        first, second = (self.plant.get_body(index).name() for index in pair)
        return Clearance(float(spares[nearest]) + margin, margin, (first, second))

    def edge(self, q1: Vector, q2: Vector) -> Vector:
        """Configurations from `q1` to `q2`, both included, shape (n, N).

        They divide the straight line evenly, no point moving further than `step`.
        """
        count = 1 + int(np.ceil(self.levers @ np.abs(q2 - q1) / self.step))
        return q1 + np.linspace(0.0, 1.0, max(count, 2))[:, np.newaxis] * (q2 - q1)

    def is_edge_free(self, q1: Vector, q2: Vector) -> bool:
        """Whether the straight line from `q1` to `q2` keeps every margin."""
        samples = self.edge(q1, q2)
        # Every eighth first: what blocks a line is mostly wider than eight steps.
        coarse, fine = samples[::8], np.delete(samples, np.s_[::8], axis=0)
        return all(map(self.is_free, coarse)) and all(map(self.is_free, fine))

    def first_hit(
        self, samples: Iterable[Vector], tolerance: float = 0.0
    ) -> Clearance | None:
        """The first clearance among `samples` that breaks a margin, else None.

        Breaking it by less than `tolerance` [m] does not count.
        """
        for q in samples:
            if not self.is_free(q):
                clearance = self.clearance(q)
                if clearance.spare <= -tolerance:
                    return clearance
        return None

    def touches(
        self, q: Vector, shape: Shape, X_WO: RigidTransform, *, within: float = 0.0
    ) -> bool:
        """Whether arm, gripper or held object are `within` of `shape` at `X_WO` [m]."""
        with self.standing(shape, X_WO):
            found = self._checker.CalcRobotClearance(self.positions(q), within)
            pairs = zip(found.robot_indices(), found.other_indices(), strict=True)
            return any(
                other == self._obstacle.index()
                and spare + float(self._checker.GetPaddingBetween(body, other))
                <= within
                for (body, other), spare in zip(pairs, found.distances(), strict=True)
            )

    @contextlib.contextmanager
    def holding(
        self, shape: Shape, X_GO: RigidTransform, *, margin: float | None = None
    ) -> Iterator[None]:
        """Within the context, the hand carries `shape` at `X_GO`.

        Args:
            shape: the object's.
            X_GO: the object's pose in the hand [m].
            margin: distance it keeps from furniture [m]; default, the hand's.
        """
        held, obstacle = self._held.index(), self._obstacle.index()
        self._SetMargin(held, self._hand_margin if margin is None else margin)
        self._checker.SetPaddingBetween(held, obstacle, self._hand_margin)
        try:
            with self._added_shape(self._held, shape, X_GO):
                yield
        finally:
            self._SetMargin(held, self._hand_margin)

    @contextlib.contextmanager
    def standing(
        self, shape: Shape, X_WO: RigidTransform, *, touchable: bool = False
    ) -> Iterator[None]:
        """Within the context, `shape` stands at `X_WO` [m].

        A `touchable` one is no obstacle to gripper and held object, only to the arm.
        """
        body = self._standing if touchable else self._obstacle
        with self._added_shape(body, shape, X_WO):
            yield

    @contextlib.contextmanager
    def _added_shape(
        self, body: RigidBody, shape: Shape, X_BO: RigidTransform
    ) -> Iterator[None]:
        group = f"shape_{len(self._checker.GetAllAddedCollisionShapes())}"
        self._checker.AddCollisionShapeToBody(group, body, _to_drake(shape), X_BO)
        try:
            yield
        finally:
            self._checker.RemoveAllAddedCollisionShapes(group)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)


def _to_drake(shape: Shape) -> geometry.Shape:
    match shape:
        case Cylinder(radius, length):
            return geometry.Cylinder(radius, length)
        case Box(size):
            return geometry.Box(*size)
        case Sphere(radius):
            return geometry.Sphere(radius)
