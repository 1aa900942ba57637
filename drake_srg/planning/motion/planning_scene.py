"""The collision checker of planning, and reasons for failures."""

import contextlib
import copy
import dataclasses as dc
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from pydrake.common import Parallelism
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    ModelInstanceIndex,
    RigidBody,
    SpatialInertia,
)
from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker
from pydrake.trajectories import Trajectory

from drake_srg.common.geometry import Solid, drake_shape
from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.types import Failure, Vector


@dc.dataclass(frozen=True)
class Clearance:
    """The pair of bodies that comes closest to breaking its margin."""

    distance: float  # signed distance [m]; inf if nothing is near
    margin: float  # the distance that this pair must keep [m]
    bodies: tuple[str, str]

    @property
    def spare(self) -> float:
        """Distance beyond the margin [m]; negative if the margin is broken."""
        return self.distance - self.margin

    def __str__(self) -> str:
        first, second = self.bodies
        if self.distance < 0.0:
            return f"{first} and {second} overlap by {-1e3 * self.distance:.1f} mm"
        return (
            f"{first} and {second} are {1e3 * self.distance:.1f} mm apart, "
            f"must be {1e3 * self.margin:.1f} mm"
        )


@dc.dataclass(frozen=True)
class PlanningFailure:
    """The reason why there is no path, motion or plan."""

    failure: Failure
    message: str
    picking: bool = False  # no grasp takes the object, wherever it is to be placed


def most_specific(failures: Sequence[PlanningFailure]) -> PlanningFailure:
    """Return the first failure that is due to the surroundings, or else the first one.

    It explains more than a target out of the arm's reach.
    """
    blocked = [f for f in failures if f.failure is Failure.BLOCKED]
    return (blocked or failures)[0]


class NoPathError(Exception):
    """Raised if there is no such path or motion; `failure` has the reason."""

    def __init__(self, failure: PlanningFailure) -> None:
        super().__init__(failure.message)
        self.failure = failure


# Longest part of a path, as a sum of joint motions, for which `travel` is tight [rad].
_CLOSE = 0.2


def _weld_free_bodies(plant: MultibodyPlant) -> None:
    """Weld the free bodies of an unfinalized plant to their initial places.

    Raises:
        ValueError: If a body has no default pose: it would be at the world's origin.
    """
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    carried = {joint.child_body().index() for joint in joints}
    carried.add(plant.world_body().index())
    for index in map(BodyIndex, range(plant.num_bodies())):
        if index in carried:
            continue
        body = plant.get_body(index)
        X_WB = plant.GetDefaultFloatingBaseBodyPose(body)
        if X_WB.IsExactlyIdentity():
            raise ValueError(
                f"{body.scoped_name()}: a free body without a pose (allowed: a weld, "
                "or SetDefaultFloatingBaseBodyPose)"
            )
        plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WB)


class PlanningScene(ArmModel):
    """An arm model that checks collisions, with or without an object in the hand.

    Frame O is an object's frame (see `drake_srg.types.Shape`); for `q`, G and W see
    `ArmModel`.

    Each body keeps a distance from the surroundings: links of the arm keep `margin`,
    the gripper `hand_margin` (fingers work near tables), and a held object its own.
    Links of the arm must not touch each other, but keep no margin. Bodies of the
    gripper may touch each other, the held object, and `touchable` shapes.

    A held object touches its support when it is picked and placed. Give it a negative
    margin there, such as -0.003 m, and an overlap of 3 mm with furniture counts as
    free. The object still keeps the gripper's distance from obstacles.

    Along a path, no point moves farther than `step` between checks (see
    `ArmModel.travel`): twice the smaller margin, so that nothing can collide between
    two checks.

    Args:
        builder: Builder with arm, gripper and furniture, not finalized. The scene
            builds it and takes its diagram. Free bodies stay at their default poses.
        arm: Name of the arm's model instance.
        gripper: Name of the gripper's model instance, welded to the arm. Its body
            `palm` is G, whose pose is planned.
        margin: Distance that the arm keeps from its surroundings [m].
        hand_margin: Distance that the gripper keeps from them [m].
        payload: Mass at G's origin that torque limits always include [kg].

    Attributes:
        step: Largest motion of any point between two checks [m].

    Raises:
        ValueError: If a margin is not positive, or a free body has no default pose: it
            would be at the world's origin.
        RuntimeError: (Drake's) If a name is unknown or the plant is finalized.
    """

    def __init__(
        self,
        builder: RobotDiagramBuilder,
        *,
        arm: str = "arm",
        gripper: str = "gripper",
        margin: float = 0.01,
        hand_margin: float = 0.005,
        payload: float = 0.0,
    ) -> None:
        if margin <= 0.0 or hand_margin <= 0.0:
            raise ValueError("margin and hand_margin must be positive")
        self.step = 2.0 * min(margin, hand_margin)
        plant = builder.plant()
        _weld_free_bodies(plant)
        arm_model = plant.GetModelInstanceByName(arm)
        gripper_model = plant.GetModelInstanceByName(gripper)
        hand_frame = plant.GetFrameByName("palm", gripper_model)
        inertia = SpatialInertia.SolidSphereWithMass(max(payload, 1e-9), 0.03)
        self._held = plant.AddRigidBody("held_object", gripper_model, inertia)
        plant.WeldFrames(hand_frame, self._held.body_frame())
        others = plant.AddModelInstance("planning_obstacles")
        self._standing = plant.AddRigidBody("standing_object", others)
        self._obstacle = plant.AddRigidBody("obstacle", others)
        for body in (self._standing, self._obstacle):
            plant.WeldFrames(plant.world_frame(), body.body_frame())

        with _quiet():  # Drake announces its contexts at every construction
            self._checker = SceneGraphCollisionChecker(
                model=builder.Build(),
                robot_model_instances=[arm_model, gripper_model],
                edge_step_size=self.step,  # required, but samples() makes the steps
                implicit_context_parallelism=Parallelism(1),
            )
        super().__init__(self._checker.plant(), arm_model, gripper_model, hand_frame)
        self._hand_margin = hand_margin
        self._SetMargins(gripper_model, margin)

    def _SetMargins(self, gripper: ModelInstanceIndex, margin: float) -> None:
        bodies = list(map(self.plant.get_body, self.plant.GetBodyIndices(gripper)))
        for i, body in enumerate(bodies):
            self._checker.SetCollisionFilteredBetween(body, self._standing, True)
            for other in bodies[:i]:
                self._checker.SetCollisionFilteredBetween(body, other, True)
        self._checker.SetPaddingAllRobotEnvironmentPairs(margin)
        for body in bodies:
            self._SetMargin(body.index(), self._hand_margin)

    def _SetMargin(self, body: BodyIndex, margin: float) -> None:
        self._checker.SetPaddingOneRobotBodyAllEnvironmentPairs(body, margin)

    def copy(self) -> "PlanningScene":
        """Return a scene with the same model and an independent state.

        It takes a tenth of the time of building one.
        """
        twin = copy.copy(self)
        twin._checker = self._checker.Clone()
        twin.plant = twin._checker.plant()
        twin.context = twin.plant.CreateDefaultContext()
        twin._positions = self._positions.copy()
        return twin

    def is_free(self, q: Vector) -> bool:
        """Return whether every pair of bodies keeps its margin at `q`."""
        return self._checker.CheckConfigCollisionFree(self.positions(q))

    def clearance(self, q: Vector, influence: float = 0.05) -> Clearance:
        """Return the pair nearest to breaking its margin at `q`.

        Pairs farther apart than `influence` [m] beyond their margin are ignored.
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

    def samples(self, path: Vector) -> Vector:
        """Return configurations on a path, both ends included, shape (M, N) [rad].

        No point moves farther than `step` from one to the next.

        Args:
            path: At least two waypoints, which straight lines connect, shape (K, N)
                [rad]. Inner waypoints need not be among the samples.
        """
        turns = np.abs(np.diff(path, axis=0)).sum(axis=1)
        parts = np.maximum(1, np.ceil(turns / _CLOSE)).astype(int)
        # Waypoints at which the parts of the path end.
        ends = np.repeat(np.arange(len(parts)), parts) + np.concatenate(
            [np.arange(n) / n for n in parts]
        )
        ends = np.append(ends, len(parts))
        moved = np.append(0.0, np.cumsum(self.travel(_at(path, ends))))
        count = 1 + int(np.ceil(moved[-1] / self.step))
        marks = np.linspace(0.0, moved[-1], max(count, 2))
        return _at(path, np.interp(marks, moved, ends))

    def is_edge_free(self, q1: Vector, q2: Vector) -> bool:
        """Return whether the straight line from `q1` to `q2` keeps every margin."""
        samples = self.samples(np.array([q1, q2]))
        # Check every eighth first: most obstacles are wider than eight steps.
        coarse, fine = samples[::8], np.delete(samples, np.s_[::8], axis=0)
        return all(map(self.is_free, coarse)) and all(map(self.is_free, fine))

    def first_hit(
        self, samples: Iterable[Vector], tolerance: float = 0.0
    ) -> Clearance | None:
        """Return the first broken margin among `samples`, or None.

        Breaking it by less than `tolerance` [m] does not count.
        """
        for q in samples:
            if not self.is_free(q):
                clearance = self.clearance(q)
                if clearance.spare <= -tolerance:
                    return clearance
        return None

    def touches(
        self, q: Vector, shape: Solid, X_WO: RigidTransform, *, within: float = 0.0
    ) -> bool:
        """Return whether arm, gripper or held object come `within` [m] of a shape.

        Args:
            q: Posture of the arm.
            shape: The shape.
            X_WO: The shape's pose [m].
            within: The largest distance that counts [m].
        """
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
        self, shape: Solid, X_GO: RigidTransform, *, margin: float | None = None
    ) -> Iterator[None]:
        """Let the hand carry `shape` within the context.

        Args:
            shape: The object's shape.
            X_GO: The object's pose in the hand [m].
            margin: Distance that it keeps from furniture [m]; None: the hand's.
        """
        with self._added_shape(self._held, shape, X_GO):
            if margin is None:
                yield
            else:
                with self.supporting(margin):
                    yield

    @contextlib.contextmanager
    def supporting(self, margin: float) -> Iterator[None]:
        """Let the held object come within `margin` [m] of furniture in the context."""
        held, obstacle = self._held.index(), self._obstacle.index()
        self._SetMargin(held, margin)
        self._checker.SetPaddingBetween(held, obstacle, self._hand_margin)
        try:
            yield
        finally:
            self._SetMargin(held, self._hand_margin)

    @contextlib.contextmanager
    def shared_with(self, gripper: str) -> Iterator[None]:
        """Let another gripper, a model instance, touch the held object in the context.

        Raises:
            RuntimeError: (Drake's) If the name is unknown.
        """
        model = self.plant.GetModelInstanceByName(gripper)
        bodies = [self.plant.get_body(i) for i in self.plant.GetBodyIndices(model)]
        try:
            for body in bodies:
                self._checker.SetCollisionFilteredBetween(self._held, body, True)
            yield
        finally:
            for body in bodies:
                self._checker.SetCollisionFilteredBetween(self._held, body, False)

    @contextlib.contextmanager
    def reaching(self, margin: float) -> Iterator[None]:
        """Let the hand come within `margin` [m] of its surroundings in the context."""
        hand = self.plant.GetBodyIndices(self._gripper_model)
        try:
            for body in hand:
                self._SetMargin(body, margin)
            yield
        finally:
            for body in hand:
                self._SetMargin(body, self._hand_margin)

    @contextlib.contextmanager
    def beside(self, positions: Mapping[str, Vector]) -> Iterator[None]:
        """Move other models, such as another arm, within the context.

        Arm and gripper keep the same distances from them as from furniture.

        Args:
            positions: Positions of all joints of model instances, by the instance's
                name, in the order of the plant's positions, shape (n,) [rad or m].

        Raises:
            RuntimeError: (Drake's) If a name is unknown.
        """
        before = self._positions.copy()
        for name, values in positions.items():
            model = self.plant.GetModelInstanceByName(name)
            self.plant.SetPositionsInArray(model, values, self._positions)
        try:
            yield
        finally:
            self._positions = before

    def AddFixture(self, shape: Solid, X_WO: RigidTransform) -> None:
        """Add a shape to the furniture permanently, at X_WO [m]."""
        self._AddShape(self._obstacle, shape, X_WO)

    @contextlib.contextmanager
    def standing(
        self, shape: Solid, X_WO: RigidTransform, *, touchable: bool = False
    ) -> Iterator[None]:
        """Add `shape` at `X_WO` [m] within the context.

        A `touchable` shape blocks only the arm, not the gripper and the held object.
        """
        body = self._standing if touchable else self._obstacle
        with self._added_shape(body, shape, X_WO):
            yield

    @contextlib.contextmanager
    def _added_shape(
        self, body: RigidBody, shape: Solid, X_BO: RigidTransform
    ) -> Iterator[None]:
        group = self._AddShape(body, shape, X_BO)
        try:
            yield
        finally:
            self._checker.RemoveAllAddedCollisionShapes(group)

    def _AddShape(self, body: RigidBody, shape: Solid, X_BO: RigidTransform) -> str:
        group = f"shape_{len(self._checker.GetAllAddedCollisionShapes())}"
        self._checker.AddCollisionShapeToBody(group, body, drake_shape(shape), X_BO)
        return group


def _at(path: Vector, index: Vector) -> Vector:
    """Return the points of a path (K, N) at fractional indices."""
    numbers = np.arange(len(path))
    return np.array([np.interp(index, numbers, q) for q in path.T]).T


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)


_SAMPLES = 24  # of a motion
_NEARBY = 1e-3  # time step along the joints' speeds [s]


def carried_drift(
    scene: PlanningScene, motion: Trajectory, p_GO: Vector, time: float
) -> Vector:
    """Return how far a held object drifts in the hand's frame G, shape (3,) [m].

    In a step of h, the joints follow their speeds and the hand follows an arc, while
    the object moves along the tangent. So the object drifts at -h/2 times the hand's
    acceleration at constant joint speeds [m/s].

    Args:
        scene: The arm and the gripper.
        motion: Motion of the arm's joints [rad].
        p_GO: The object's origin in the hand [m], shape (3,).
        time: h/2 [s].
    """
    ends = np.linspace(0.0, motion.end_time(), _SAMPLES + 1)
    accelerations = []
    for t in (ends[:-1] + ends[1:]) / 2.0:
        q, v = motion.value(t).ravel(), motion.EvalDerivative(t).ravel()
        before, X_WG, after = (
            scene.X_WG(q + dt * v) for dt in (-_NEARBY, 0.0, _NEARBY)
        )
        change_W = before @ p_GO - 2.0 * (X_WG @ p_GO) + after @ p_GO
        accelerations.append(X_WG.rotation().inverse() @ change_W / _NEARBY**2)
    drift: Vector = -time * motion.end_time() * np.mean(accelerations, axis=0)
    return drift
