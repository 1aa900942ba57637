"""The dataclasses of a scenario file, which is YAML.

Plant, simulator, scene graph, model directives and cameras follow Drake's own schema.
`base: NAME` lays a file over another. Any number may be one of Drake's distributions,
drawn with `random_seed`.
"""

import contextlib
import dataclasses as dc
import functools
import operator
import typing
import zlib
from collections.abc import Iterator

from pydrake.geometry import SceneGraphConfig
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig

from drake_srg.arm.driver import ArmDriver, ArmPositionDriver
from drake_srg.arm.impedance import ArmImpedanceDriver
from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config, positive
from drake_srg.gripper.driver import GripperDriver
from drake_srg.gripper.drivers import DRIVERS
from drake_srg.objects.config import ClutterConfig, ObjectConfig, SleepingConfig
from drake_srg.objects.disturber import Force, Push, Topple
from drake_srg.objects.slides import SlideConfig
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.planning.handover.config import Handover
from drake_srg.planning.insertion.config import Insert
from drake_srg.planning.planner_machine import (
    Clear,
    PickAndPlace,
    PlannerConfig,
)
from drake_srg.planning.servoing.config import Servoing, ServoingConfig
from drake_srg.theses.blob_localizer import ThesisBlobConfig
from drake_srg.theses.script import Script, ScriptStep
from drake_srg.theses.taught import Taught
from drake_srg.vision.camera import CameraCalibrationConfig
from drake_srg.vision.camera_errors import CameraErrorsConfig
from drake_srg.vision.color import COLORS


@dc.dataclass(kw_only=True)
class TwinConfig(Config):
    """Limits of the differences between a robot and its twin; see docs/twin.md."""

    # Time between samples of the twin, in place of `arm.period` [s]. With long periods,
    # a twin lags, and misses pictures that arrive in quick succession. Null:
    # `arm.period`.
    period: float | None = dc.field(default=None, metadata=positive())
    # Largest difference between a measured joint of the arm and the twin's [rad or m].
    # The twin follows two control periods late: 0.05 rad at the fastest joint's top
    # speed in the fast kitchen.
    joint: float = dc.field(default=0.1, metadata=positive())
    # Largest difference between measured and expected torques of the arm, as a share of
    # the joint's effort limit. The iiwa's axis-specific torque accuracy is 2 % (KUKA,
    # LBR iiwa, technical data).
    torque: float = dc.field(default=0.02, metadata=positive())
    # Joint speed above which torques do not count [rad/s or m/s], because acceleration
    # and friction are known less well. `still_time` [s] is how long the arm must have
    # been slower, and how long the torque must have differed. The comparison's time
    # constant is 0.02 s. The planner's shortest rest is 0.3 s.
    still_speed: float = dc.field(default=0.005, metadata=positive())
    still_time: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Largest difference between a measured finger joint and the twin's [rad]. Fingers
    # around cans of 60 and 66 mm differ by 0.1 rad.
    finger: float = dc.field(default=0.1, metadata=positive())
    # Largest distance between an object's position as seen by a camera and in the twin
    # [m]. If the hand hides half of an object, the camera's estimate is up to 10 mm
    # off.
    object: float = dc.field(default=0.03, metadata=positive())
    # Time for which a difference must last to be reported [s]. Commands to the fingers
    # arrive up to 0.1 s early or late.
    patience: float = dc.field(default=0.3, metadata={"ge": 0.0})
    # Time without reports at first, and after a gap of more than `patience` between
    # messages [s]: the twin's fingers need it to reach their command.
    settle: float = dc.field(default=2.0, metadata={"ge": 0.0})
    # The twin ends when the robot has been silent for this long [s, real].
    silence: float = dc.field(default=3.0, metadata=positive())
    # Topics; empty: no such topic. `blobs` has the cameras' sightings, std_msgs/String
    # as published by `serve`. The others have the commands to the gripper: `closure`,
    # std_msgs/Float64, 0 open .. 1 closed, and `grasp`, std_msgs/Int32, 0 open .. 100
    # closed. A name without a leading slash is the arm's own: `grasp` is /left/grasp
    # for the arm `left`.
    blobs: str = "/blobs"
    closure: str = "gripper/closure_commanded"
    grasp: str = "grasp"


# The arm drivers of the package. The name of a driver's class is its tag.
ARM_DRIVERS: tuple[type[ArmDriver], ...] = (ArmPositionDriver, ArmImpedanceDriver)

# The planners' configurations in the package. The name of the class is the planner's
# tag in scenario files. To add one of your own, call
# `drake_srg.station.register_planner`.
PLANNERS: tuple[type[PlannerConfig], ...] = (
    PickAndPlace,
    Clear,
    Servoing,
    Insert,
    Handover,
    CarryTogether,
    Taught,
    Script,
)

if typing.TYPE_CHECKING:
    _ArmDriver = ArmDriver
    _Driver = GripperDriver
    _Planner = PlannerConfig
else:  # the classes that a tag selects from
    _Planner = functools.reduce(operator.or_, PLANNERS)
    _ArmDriver = functools.reduce(operator.or_, ARM_DRIVERS)
    _Driver = functools.reduce(operator.or_, DRIVERS)


@dc.dataclass(kw_only=True)
class SelectionConfig(Config):
    """Objects to take: by name, by colour, or all.

    Written as `[NAME, ...]`, as `{colour: COLOUR}`, or as `all`.
    """

    # Names of objects that the localizer knows: each has a `shape` or a `color_range`.
    names: list[str] = dc.field(default_factory=list)
    # Name of a colour; it must be that of most of the object's visible surface.
    colour: str = dc.field(default="", metadata={"among": ("", *COLORS)})


@dc.dataclass(kw_only=True)
class RowConfig(Config):
    """Places side by side, one for each name in `task.pick`, in the same order."""

    # [x, y] of the first object's centre in world [m].
    start: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )
    # Direction of the row from the world's x [rad], and the distance between centres
    # [m]. The fingers close across the row, so that they do not touch neighbours.
    direction: float = 0.0
    spacing: float = dc.field(default=0.12, metadata=positive())
    # Largest distance from its place at which an object counts as placed [m].
    tolerance: float = dc.field(default=0.01, metadata=positive())


@dc.dataclass(kw_only=True)
class PlaceConfig(Config):
    """The goal of the picked object."""

    # [x, y] of the object's centre on the table in world [m].
    position: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )
    # Height of the goal's surface in world [m]; null: the table's.
    height: float | None = None
    # Largest distance from the goal at which the task counts as done [m].
    tolerance: float = dc.field(default=0.005, metadata=positive())
    # URL of a model that marks the place; empty: none.
    marker: str = ""
    # Name of a model among `directives`, an open box: objects are dropped into it
    # instead of being set down. The other keys do not apply.
    bin: str = ""
    # Several bins by name, like `bin`, and the objects for each. Names have priority
    # over colours, and colours over `all`. Objects that suit no bin stay. Loading the
    # scenario adds `bin`.
    bins: dict[str, SelectionConfig] = dc.field(default_factory=dict)
    # A row in which standing objects are set down again, upright, at `height`. Needs a
    # list of names as `task.pick`.
    row: RowConfig | None = None
    # Cameras that look at the destinations of loads, besides those of the localizer.
    # Only with `bin`, `bins` or `row`.
    cameras: list[str] = dc.field(default_factory=list)


@dc.dataclass(kw_only=True)
class RegionConfig(Config):
    """A rectangle on the table: its corners [x, y] in world [m]."""

    min: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )
    max: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )


@dc.dataclass(kw_only=True)
class TableConfig(RegionConfig):
    """A horizontal table top: its corners and height in world [m]."""

    height: float = 0.0


@dc.dataclass(kw_only=True)
class ClearConfig(Config):
    """Objects of any shape to clear away, one after another."""

    # Names of the objects. Loading the scenario fills them in from `task.pick`.
    objects: list[str] = dc.field(default_factory=list)
    # Region in which the planner looks for objects, except in the bin.
    region: RegionConfig = dc.field(default_factory=RegionConfig)


@dc.dataclass(kw_only=True)
class TaskConfig(Config):
    """The planner's task: pick and place one object, or clear many off the table."""

    # Name of the object; empty: nothing to do. With `place.bin`, `all`, a list of names
    # or a colour (see SelectionConfig); with `place.bins`, `all`. Loading the scenario
    # moves the names to `clear.objects`, and `pick` is then empty.
    pick: str = ""
    clear: ClearConfig | None = None
    place: PlaceConfig = dc.field(default_factory=PlaceConfig)
    # Number of cycles. Every second cycle returns the object to its first place. A
    # script is played this many times.
    repeat: int = dc.field(default=1, metadata={"ge": 1})
    # Region in which objects without a position are placed, and the least distance
    # between centres [m]. 0.15 leaves room for an open finger of the SRG between two
    # objects.
    region: RegionConfig = dc.field(default_factory=RegionConfig)
    spacing: float = dc.field(default=0.15, metadata=positive())


@dc.dataclass(kw_only=True)
class LocalizerConfig(Config):
    """Configuration of the localizer, which finds objects in images."""

    # Names in `cameras`, each once.
    cameras: list[str] = dc.field(default_factory=list)
    # Smallest blob [pixels].
    min_area: int = dc.field(default=50, metadata={"ge": 1})
    # Whether to detect unknown obstacles, for the planner to avoid. The search covers
    # `task.region` and the goal, each extended by `task.spacing`.
    obstacles: bool = False
    # Whether to correct the cameras' tilt and height by the visible level surfaces:
    # `table` and the goal's surroundings.
    level_cameras: bool = False
    # The localizer of the five-axis arm's thesis. It takes one camera and finds only
    # `task.pick`; the keys `min_area` and `level_cameras` do not apply.
    thesis: ThesisBlobConfig | None = None


@dc.dataclass(kw_only=True)
class RecordingConfig(Config):
    """Configuration of the recordings of a run. Times are simulated."""

    # Time between samples of the log [s]. It must be short, because metrics are
    # computed from the log.
    period: float = dc.field(default=0.02, metadata={"ge": 0.001, "le": 0.05})
    # Camera of video.mp4; empty: no video.
    video_camera: str = ""
    # Camera of the smaller picture in the corner of video.mp4, such as one on the hand;
    # empty: none.
    inset_camera: str = ""
    video_fps: float = dc.field(default=20.0, metadata=positive(le=240.0))
    # Cameras whose images go into recording.mcap, and the time between images [s].
    bag_cameras: list[str] = dc.field(default_factory=list)
    bag_camera_period: float = dc.field(default=0.5, metadata=positive())
    # Whether these cameras' depth images go into recording.mcap, too.
    bag_depth: bool = False
    # Whether recording.mcap shows the run in 3D: topics /tf and /scene.
    bag_scene: bool = True


@dc.dataclass(kw_only=True)
class ArmConfig(Config):
    """One of several arms: its driver, its gripper's driver, and its limits.

    Among `directives`, the model of the arm NAME must be called NAME, and that of its
    gripper NAME.gripper.
    """

    # Driver of the arm, chosen by its tag. It must be given.
    arm: _ArmDriver | None = None
    # Driver of the arm's gripper, chosen by its tag; null: there is no gripper.
    gripper: _Driver | None = None
    # Limits of the arm's motion, for any source of commands; null: none.
    safety: SafetyConfig | None = None


@dc.dataclass(kw_only=True)
class Scenario(Config):
    """A robot cell, its objects and its task, as a scenario file states them."""

    # Seed of all random draws.
    random_seed: int = dc.field(default=0, metadata={"ge": 0})
    # Drake's configurations of plant, simulator and scene graph.
    plant_config: MultibodyPlantConfig = dc.field(default_factory=MultibodyPlantConfig)
    simulator_config: SimulatorConfig = dc.field(default_factory=SimulatorConfig)
    scene_graph_config: SceneGraphConfig = dc.field(default_factory=SceneGraphConfig)
    # Pairs of names of collision geometries, MODEL::GEOMETRY with wildcards * and ?. In
    # the simulation, they pass through each other, which saves time. The planner still
    # keeps them apart.
    ignored_contacts: list[list[str]] = dc.field(default_factory=list)
    # All models except `objects`. The actuated ones are named `arm` and `gripper`; with
    # `arms`, NAME and NAME.gripper.
    directives: list[ModelDirective] = dc.field(default_factory=list)
    # Driver of the model `arm`, chosen by its tag; null: there is no arm.
    arm: _ArmDriver | None = None
    # Driver of the model `gripper`, chosen by its tag; null: there is no gripper.
    gripper: _Driver | None = None
    # Limits of the arm's motion, for any source of commands; null: none.
    safety: SafetyConfig | None = None
    # Several arms, by name, in place of `arm`, `gripper` and `safety`; see
    # docs/two_arms.md.
    arms: dict[str, ArmConfig] = dc.field(default_factory=dict)
    # Drake's cameras, by name.
    cameras: dict[str, CameraConfig] = dc.field(default_factory=dict)
    # Imperfections of cameras by name; a camera without an entry is ideal.
    camera_errors: dict[str, CameraErrorsConfig] = dc.field(default_factory=dict)
    # Calibrations of cameras by name; see docs/calibration.md. They replace the pose
    # errors in `camera_errors`.
    camera_calibrations: dict[str, CameraCalibrationConfig] = dc.field(
        default_factory=dict
    )
    # Top of a table among the directives, on which objects stand.
    table: TableConfig = dc.field(default_factory=TableConfig)
    # The objects, by name.
    objects: dict[str, ObjectConfig] = dc.field(default_factory=dict)
    # Alternatives by group and by name, each a mapping of a scenario's keys. Loading
    # the scenario draws one of each group, and lays it over the scenario.
    choices: dict[str, dict[str, dict[str, str]]] = dc.field(default_factory=dict)
    # Names of choices by group, in place of drawn ones.
    chosen: dict[str, str] = dc.field(default_factory=dict)
    # A random number of additional objects. Loading the scenario adds them to
    # `objects`.
    clutter: ClutterConfig = dc.field(default_factory=ClutterConfig)
    # Null: objects never sleep. Needs `plant_config.time_step` above 0 and no soft
    # objects.
    sleeping: SleepingConfig | None = None
    task: TaskConfig = dc.field(default_factory=TaskConfig)
    localizer: LocalizerConfig = dc.field(default_factory=LocalizerConfig)
    # Without a tag, `!PickAndPlace`.
    planner: _Planner = dc.field(default_factory=PickAndPlace)
    # Limits of the differences between a robot and its digital twin; see docs/twin.md.
    twin: TwinConfig = dc.field(default_factory=TwinConfig)
    # Motions of furniture that carries objects, by the name of a model among
    # `directives` with one actuated joint.
    slides: dict[str, SlideConfig] = dc.field(default_factory=dict)
    # Forces on objects that do not come from the robot.
    disturbances: list[Push | Topple | Force] = dc.field(default_factory=list)
    recording: RecordingConfig = dc.field(default_factory=RecordingConfig)


def accept_driver(driver: type[GripperDriver]) -> None:
    """Accept a driver of your own in `gripper` of scenario files, tagged by its name.

    `drake_srg.station.register_gripper` calls this.
    """
    _accept("gripper", driver)


def accept_planner(planner: type[PlannerConfig]) -> None:
    """Accept a planner of your own in `planner` of scenario files, tagged by its name.

    `drake_srg.station.register_planner` calls this.
    """
    _accept("planner", planner)


def _accept(key: str, accepted: type[object]) -> None:
    for owner in (Scenario, ArmConfig):
        for field in dc.fields(owner):
            if field.name == key:
                _widen(owner, field, accepted)


def _widen(
    owner: type[object], field: dc.Field[typing.Any], accepted: type[object]
) -> None:
    # `None`, if the field allows it, stays last.
    known = [kind for kind in typing.get_args(field.type) if kind is not type(None)]
    optional = [None] if len(known) < len(typing.get_args(field.type)) else []
    known = [other for other in known if other.__name__ != accepted.__name__]
    # Derived classes come first: Drake writes the tag of the first class that fits.
    known = sorted([accepted, *known], key=lambda kind: -len(kind.__mro__))
    choice = functools.reduce(operator.or_, [*known, *optional])
    # Up to Drake 1.58, its YAML functions know the tags of a field only from its type
    # (`field.type`), but a user's own class is registered at run time. A second
    # Scenario class would be another type than the one that all functions take. So
    # widen the type here, in the field for Drake and in the annotation for
    # `check_tree`.
    field.type = owner.__annotations__[field.name] = choice


@dc.dataclass(frozen=True)
class RobotArm:
    """An arm with its gripper, and the names that distinguish it from other arms.

    The arm in a scenario's `arm` and `gripper` has an empty name, so code for several
    arms also works for one.
    """

    name: str = ""  # empty: the scenario's only arm
    arm: ArmDriver | None = None
    gripper: GripperDriver | None = None
    safety: SafetyConfig | None = None

    @property
    def prefix(self) -> str:
        """Prefix of port names that would otherwise be ambiguous."""
        return f"{self.name}." if self.name else ""

    @property
    def arm_model(self) -> str:
        """Name of the arm's model instance, and start of its ports: `arm` or NAME."""
        return self.name or "arm"

    @property
    def gripper_model(self) -> str:
        """Like `arm_model`, for the gripper: `gripper` or `NAME.gripper`."""
        return f"{self.prefix}gripper"

    @property
    def key(self) -> str:
        """Prefix of the keys `arm`, `gripper` and `safety` in the scenario."""
        return f"arms.{self.name}." if self.name else ""

    @contextlib.contextmanager
    def named_errors(self) -> Iterator[None]:
        """Put the arm's name in front of keys in error messages."""
        try:
            yield
        except (ScenarioError, ValueError) as error:
            words = str(error)
            if self.name and words.startswith(("arm", "gripper", "safety")):
                raise ScenarioError(f"{self.key}{words}") from None
            raise

    def system(self, name: str) -> str:
        """Return the name of the arm's own system in a diagram."""
        return f"{self.name}_{name}" if self.name else name

    def seed(self, seed: int) -> int:
        """Return the seed of the arm's noise, unique for each arm."""
        return zlib.crc32(f"{seed}/{self.name}".encode()) if self.name else seed


def robot_arms(scenario: Scenario) -> list[RobotArm]:
    """Return a scenario's arms; without `arms`, one, whose parts may be None."""
    if not scenario.arms:
        return [RobotArm("", scenario.arm, scenario.gripper, scenario.safety)]
    return [
        RobotArm(name, each.arm, each.gripper, each.safety)
        for name, each in scenario.arms.items()
    ]


def check_single_arm(scenario: Scenario, what: str) -> None:
    """Check that a scenario has no more than one arm.

    Args:
        scenario: The scenario.
        what: The feature that supports one arm only, for the message.

    Raises:
        ScenarioError: If the scenario uses `arms`.
    """
    if scenario.arms:
        raise ScenarioError(
            f"arms: {what} takes one arm, got {', '.join(scenario.arms)} (allowed: a "
            "scenario with arm and gripper)"
        )


def script_of(scenario: Scenario) -> list[ScriptStep]:
    """Return the steps of a scenario's script; empty if it has another planner."""
    planner = scenario.planner
    return planner.steps if isinstance(planner, Script) else []


def servo_of(scenario: Scenario) -> ServoingConfig | None:
    """Return the configuration of a scenario's visual servo, if it has one."""
    planner = scenario.planner
    return planner.servo if isinstance(planner, Servoing) else None


def perception_cameras(scenario: Scenario) -> list[str]:
    """Return the names of the planner's cameras, each once."""
    return list(
        dict.fromkeys([*scenario.localizer.cameras, *scenario.task.place.cameras])
    )


def is_continuous(scenario: Scenario) -> bool:
    """Return whether the plant is continuous, to be advanced by Drake's CENIC."""
    return bool(scenario.plant_config.time_step == 0.0)
