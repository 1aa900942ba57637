"""What is simulated: a scenario file and the dataclasses that it fills.

A scenario is YAML in Drake's own schema where Drake has one (plant, simulator, scene
graph, model directives, cameras). `base: NAME` lays a file over another. Any numeric
field may be one of Drake's distributions, drawn from `random_seed`.
"""

import dataclasses as dc
import functools
import operator
import typing

from pydrake.geometry import SceneGraphConfig
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig

from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.gripper.drivers import DRIVERS, GripperDriver
from drake_srg.objects.config import ClutterConfig, ObjectConfig
from drake_srg.objects.disturbances import Force, Push, Topple
from drake_srg.planning.script.messages import MessagesConfig
from drake_srg.planning.script.scripted import ScriptStep
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.types import positive
from drake_srg.vision.camera_errors import CameraErrorsConfig
from drake_srg.vision.config import LocalizerThresholds

if typing.TYPE_CHECKING:
    _Driver = GripperDriver
else:  # the classes among which a tag chooses
    _Driver = functools.reduce(operator.or_, DRIVERS)


@dc.dataclass(kw_only=True)
class PlaceConfig:
    """Where the picked object goes."""

    # [x, y] of the object's centre on the table, in world [m].
    position: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )
    # Height of what it is set on there [m]; null: the table's.
    height: float | None = None
    # Distance from there within which the task counts as done [m].
    tolerance: float = dc.field(default=0.005, metadata=positive())
    # Model that marks the place; empty: none.
    marker: str = ""


@dc.dataclass(kw_only=True)
class RegionConfig:
    """A rectangle on the table, in world [m]."""

    min: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )
    max: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )


@dc.dataclass(kw_only=True)
class TableConfig(RegionConfig):
    """A horizontal table top, in world [m]."""

    height: float = 0.0


@dc.dataclass(kw_only=True)
class TaskConfig:
    """What the planner is asked to do."""

    pick: str = ""  # name of the object; empty: nothing to do
    place: PlaceConfig = dc.field(default_factory=PlaceConfig)
    # How often; every second time the object goes back to where it was first found.
    repeat: int = dc.field(default=1, metadata={"ge": 1})
    # Where objects without a position may stand, and how far from each other's centres
    # [m]: 0.15 leaves room for an open finger of the SRG between two of them.
    region: RegionConfig = dc.field(default_factory=RegionConfig)
    spacing: float = dc.field(default=0.15, metadata=positive())


@dc.dataclass(kw_only=True)
class LocalizerConfig:
    """How objects are found in images."""

    # Names in `cameras`, each once.
    cameras: list[str] = dc.field(default_factory=list)
    # Smallest blob [pixels].
    min_area: int = dc.field(default=50, metadata={"ge": 1})
    # Whether things that are not known objects are looked for, to keep clear of them:
    # in `task.region` and around the goal, `task.spacing` beyond.
    obstacles: bool = False
    # Whether `table`, and what is around the goal, tell how the cameras are tilted and
    # how high they are.
    level_cameras: bool = False
    # Time between images [s]; 0 renders only when the blobs are asked for.
    period: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # For poor images and other objects than these scenarios have.
    thresholds: LocalizerThresholds = dc.field(default_factory=LocalizerThresholds)


@dc.dataclass(kw_only=True)
class RecordingConfig:
    """What a run records. Times are simulated."""

    # Of the log [s]. Metrics are computed from the log, so that it must be fine enough.
    period: float = dc.field(default=0.02, metadata={"ge": 0.001, "le": 0.05})
    # Camera of video.mp4; empty: no video.
    video_camera: str = ""
    video_fps: float = dc.field(default=20.0, metadata=positive(le=240.0))
    # Cameras whose images go into recording.mcap, and how often [s].
    bag_cameras: list[str] = dc.field(default_factory=list)
    bag_camera_period: float = dc.field(default=0.5, metadata=positive())


@dc.dataclass(kw_only=True)
class Scenario:
    """A robot cell, its objects and its task; see the module's docstring."""

    # Seed of everything that is random.
    random_seed: int = dc.field(default=0, metadata={"ge": 0})
    # Drake's configuration of plant, simulator and scene graph.
    plant_config: MultibodyPlantConfig = dc.field(default_factory=MultibodyPlantConfig)
    simulator_config: SimulatorConfig = dc.field(default_factory=SimulatorConfig)
    scene_graph_config: SceneGraphConfig = dc.field(default_factory=SceneGraphConfig)
    # Pairs of names of collision geometry, MODEL::GEOMETRY with wildcards * and ?, that
    # the simulation lets pass through each other: it need not look at them then. The
    # planner keeps them apart all the same.
    ignored_contacts: list[list[str]] = dc.field(default_factory=list)
    # All models that are not `objects`. The driven ones are named `arm` and `gripper`.
    directives: list[ModelDirective] = dc.field(default_factory=list)
    arm: ArmPositionDriver | None = None
    gripper: _Driver | None = None
    cameras: dict[str, CameraConfig] = dc.field(default_factory=dict)
    # How they differ from ideal ones, by their names; those without an entry do not.
    camera_errors: dict[str, CameraErrorsConfig] = dc.field(default_factory=dict)
    # The top on which objects stand, of a table among the directives.
    table: TableConfig = dc.field(default_factory=TableConfig)
    objects: dict[str, ObjectConfig] = dc.field(default_factory=dict)
    # More objects, as many as are drawn; loaded, they are among `objects`.
    clutter: ClutterConfig = dc.field(default_factory=ClutterConfig)
    task: TaskConfig = dc.field(default_factory=TaskConfig)
    localizer: LocalizerConfig = dc.field(default_factory=LocalizerConfig)
    planner: PlannerConfig = dc.field(default_factory=PlannerConfig)
    # What arm and gripper do, step by step, instead of what localizer and planner find.
    script: list[ScriptStep] = dc.field(default_factory=list)
    # Messages that arm and gripper get, as a client of the thesis sends them: loaded,
    # they are the script. The arm's targets are reached within `arm.limits`.
    messages: MessagesConfig | None = None
    # What happens to objects besides.
    disturbances: list[Push | Topple | Force] = dc.field(default_factory=list)
    recording: RecordingConfig = dc.field(default_factory=RecordingConfig)


def accept_driver(driver: type[GripperDriver]) -> None:
    """Let `gripper` of scenario files be a driver of your own, tagged by its name.

    See `drake_srg.cell.register_gripper`, which calls this.
    """
    (field,) = (field for field in dc.fields(Scenario) if field.name == "gripper")
    known = [*typing.get_args(field.type)[:-1]]  # None is the last
    known = [other for other in known if other.__name__ != driver.__name__]
    choice = functools.reduce(operator.or_, [*known, driver, None])
    # `check_tree` reads the annotation, Drake's YAML functions read the field.
    field.type = Scenario.__annotations__["gripper"] = choice


def is_continuous(scenario: Scenario) -> bool:
    """Whether the plant is one that Drake's CENIC integrator advances."""
    return bool(scenario.plant_config.time_step == 0.0)
