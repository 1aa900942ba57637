"""Scenes of the varied scenarios, and how well the picked object is located in them.

A scene is drawn from a seed: objects, clutter, lights, occlusion and camera errors.
Nothing is simulated. Only the first images are judged.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from drake_srg.experiments.row import Row
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.station.perception import AddLocalizer, AddObstacleFinder
from drake_srg.types import Blob, BlobFlag, Obstacle, Shape, Vector

# Scenarios, and the greatest error of position with which the object can be picked [m]:
# half of what the kitchen's goal allows, and what the five-axis arm's open fingers
# allow.
WITHIN = {"kitchen_varied": 3e-3, "assistive_arm_varied": 1.5e-3}
ANOTHER = 0.02  # a sighting farther off shows another thing [m]
_LEAST_SHARE = 0.95  # of scenes in which the object is located that well
_LOW = 0.008  # lower things need not be found [m]: ObstacleFinder's min_height


@dc.dataclass(frozen=True)
class Scene:
    """How the picked object is located in a scene.

    Attributes:
        distance: From the best blob to the picked object [m]; NaN without a blob.
        certain: Whether the best blob is certain.
        turn: Angle between their axes [rad], whose ends look alike; NaN without a blob.
    """

    distance: float
    certain: bool
    turn: float = 0.0


@dc.dataclass(frozen=True)
class Obstacles:
    """How the clutter of a scene is found.

    Attributes:
        missed: Number of things that no obstacle covers.
        invented: Number of obstacles that cover no thing.
        errors: Errors of the heights of obstacles that cover one thing [m].
    """

    missed: int
    invented: int
    errors: tuple[float, ...]


class Scenery:
    """A scene that is rendered once and may be perceived several times.

    Args:
        scenario_name: A scenario whose localizer finds obstacles.
        seed: The seed from which the scene is drawn.
        overrides: See `load_scenario`.
    """

    def __init__(self, scenario_name: str, seed: int, overrides: Sequence[str] = ()):
        self._scenario = load_scenario(scenario_name, seed=seed, overrides=overrides)
        self._station = MakeStation(self._scenario)
        self._context = self._station.CreateDefaultContext()

    @property
    def shape(self) -> Shape | None:
        """True shape of the picked object; None for a model without a simple shape."""
        name = self._scenario.task.pick
        return simple_shape(name, self._scenario.objects[name])

    def pose(self) -> RigidTransform:
        """Return the pose X_WO of the picked object."""
        return self._poses()[self._scenario.task.pick]

    def put(self, X_WO: RigidTransform) -> None:
        """Move the picked object."""
        plant = self._station.GetSubsystemByName("plant")
        context = plant.GetMyMutableContextFromRoot(self._context)
        put_object(plant, context, self._scenario.task.pick, X_WO)

    def look(self) -> tuple[Scene, Obstacles]:
        """Locate the picked object and the obstacles in the scene's images."""
        scenario = self._scenario
        builder = DiagramBuilder()
        images = builder.AddSystem(self._make_images())
        localizer = AddLocalizer(builder, scenario, images)
        finder = AddObstacleFinder(builder, scenario, images, localizer)
        context = builder.Build().CreateDefaultContext()
        blobs, obstacles = (
            system.get_output_port().Eval(system.GetMyContextFromRoot(context))
            for system in (localizer, finder)
        )
        return self._compare_blobs(blobs), self._compare_obstacles(obstacles)

    def _make_images(self) -> Diagram:
        """Return constant sources in place of the station's cameras."""
        builder = DiagramBuilder()
        for camera in self._scenario.localizer.cameras:
            for port in ("color_image", "depth_image", "body_pose_in_world"):
                name = f"camera_{camera}.{port}"
                image = self._station.GetOutputPort(name).Eval(self._context)
                source = ConstantValueSource(AbstractValue.Make(image))
                builder.AddSystem(source)
                builder.ExportOutput(source.get_output_port(), name)
        return builder.Build()

    def _compare_blobs(self, blobs: Sequence[Blob]) -> Scene:
        own = [b for b in blobs if b.object_name == self._scenario.task.pick]
        if not own:
            return Scene(np.nan, False, np.nan)
        best, X_WO = own[0], self.pose()
        return Scene(
            float(np.linalg.norm(best.position - X_WO.translation())),
            BlobFlag.UNCERTAIN not in best.flags,
            angle_between_axes(best.axis, X_WO.rotation().matrix()[:, 2]),
        )

    def _compare_obstacles(self, obstacles: Sequence[Obstacle]) -> Obstacles:
        poses = self._poses()
        things = [
            (poses[name], config)
            for name, config in self._scenario.objects.items()
            if not config.known
        ]
        return match(obstacles, things)

    def _poses(self) -> dict[str, RigidTransform]:
        port = self._station.GetOutputPort("object_poses_cheat")
        poses: dict[str, RigidTransform] = port.Eval(self._context)
        return poses


def put_object(
    plant: MultibodyPlant, context: Context, name: str, X_WO: RigidTransform
) -> None:
    """Move an object of one link in a plant's context."""
    (index,) = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
    plant.SetFreeBodyPose(context, plant.get_body(index), X_WO)


def angle_between_axes(a: Vector, b: Vector) -> float:
    """Return the angle between two axes whose ends look alike [rad]."""
    turn = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return float(min(turn, np.pi - turn))


def match(
    found: Sequence[Obstacle], things: Sequence[tuple[RigidTransform, ObjectConfig]]
) -> Obstacles:
    """Compare obstacles with the upright things in a scene, seen from above.

    An obstacle finds a thing if it contains the thing's centre. It covers the things
    that it finds and those whose surrounding circle contains its own centre.

    Args:
        found: The obstacles.
        things: Pose X_WO and config of each thing.
    """
    sizes = [
        shape.bounding_size if (shape := simple_shape("", config)) else np.zeros(3)
        for _, config in things
    ]
    middles = [X_WO.translation() for X_WO, _ in things]
    holds = np.zeros((len(found), len(things)), bool)
    touches = holds.copy()
    for i, obstacle in enumerate(found):
        half = 0.5 * np.array(obstacle.shape.size[:2])
        for j, (middle, size) in enumerate(zip(middles, sizes, strict=True)):
            p_O = (obstacle.X_WO.inverse() @ middle)[:2]
            holds[i, j] = (np.abs(p_O) <= half).all()
            near = np.linalg.norm(p_O) <= 0.5 * np.linalg.norm(size[:2])
            touches[i, j] = holds[i, j] or near
    high = np.array([size[2] > _LOW for size in sizes], bool)
    errors = tuple(
        float(found[i].shape.height - sizes[j][2])
        for i, j in np.argwhere(holds & high)
        if holds[i].sum() == 1  # several together are as high as the highest
    )
    return Obstacles(
        missed=int((high & ~holds.any(axis=0)).sum()),
        invented=int((~touches.any(axis=1)).sum()),
        errors=errors,
    )


def look(scenario_name: str, seed: int) -> Scene:
    """Draw a scene and locate the picked object."""
    return Scenery(scenario_name, seed).look()[0]


def judge(scenario_name: str, scenes: list[Scene]) -> list[Row]:
    """Judge the scenes of a scenario."""
    distances = np.array([scene.distance for scene in scenes])
    within = WITHIN[scenario_name]
    near = float((distances <= within).mean())
    wrong = sum(s.certain and s.distance > ANOTHER for s in scenes)
    name = f"{scenario_name}, {len(scenes)} scenes"
    seen = distances[np.isfinite(distances)]
    middle, most = (1e3 * float(np.quantile(seen, q)) for q in (0.5, 0.95))
    share = f"share seen within {1e3 * within:g} mm"
    return [
        Row.at_least(name, share, _LEAST_SHARE, near, ""),
        Row.at_most(name, "another thing is taken for it", 0.0, float(wrong), ""),
        Row.info(name, "not seen", float(np.isnan(distances).sum()), ""),
        Row.info(name, "seen, but not certain", _uncertain(scenes), ""),
        Row.info(name, "error of position, median", middle, "mm"),
        Row.info(name, "error of position, 95 % quantile", most, "mm"),
    ]


def _uncertain(scenes: list[Scene]) -> float:
    return float(sum(np.isfinite(s.distance) and not s.certain for s in scenes))
