"""What is simulated: a scenario file and the dataclasses that it fills.

A scenario is YAML in Drake's own schema where Drake has one (plant, simulator, scene
graph, model directives, cameras). `base: NAME` lays a file over another. Any numeric
field may be one of Drake's distributions, drawn from `random_seed`.
"""

import dataclasses as dc
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.schema import UniformVectorX
from pydrake.geometry import SceneGraphConfig
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig

from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.clutter import add_clutter
from drake_srg.distributions import draw_distributions, key_generator
from drake_srg.disturbances import Force, Push, Topple
from drake_srg.errors import ScenarioError, scenario_errors
from drake_srg.gripper.drivers import GripperDriver
from drake_srg.object_config import ClutterConfig, ObjectConfig
from drake_srg.planning.config import PlannerConfig
from drake_srg.planning.messages import MessagesConfig, message_script
from drake_srg.planning.scripted import ScriptStep
from drake_srg.scenario_checks import check_scenario
from drake_srg.scenario_files import SCENARIOS, list_scenarios, load_tree
from drake_srg.types import Vector, positive
from drake_srg.vision.camera_errors import CameraErrorsConfig
from drake_srg.yaml_loading import load_typed

__all__ = [
    "SCENARIOS",
    "Drawn",
    "LocalizerConfig",
    "PlaceConfig",
    "RecordingConfig",
    "RegionConfig",
    "Scenario",
    "TableConfig",
    "TaskConfig",
    "draw_scenario",
    "is_continuous",
    "list_scenarios",
    "load_scenario",
    "load_tree",
]


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
    gripper: GripperDriver | None = None
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


def is_continuous(scenario: Scenario) -> bool:
    """Whether the plant is one that Drake's CENIC integrator advances."""
    return bool(scenario.plant_config.time_step == 0.0)


@dc.dataclass(frozen=True)
class Drawn:
    """A scenario with nothing left to chance, and what chance made of it."""

    scenario: Scenario
    # What was drawn, by the key that `--set` knows it by: `objects.soup_can.mass`; of
    # vectors each entry, `objects.soup_can.position[0]`.
    values: Mapping[str, float | int | str]


def draw_scenario(tree: Mapping[str, Any], origin: str, seed: int | None) -> Drawn:
    """Draw what is random in a tree of `load_tree`, load it and check it.

    Args:
        tree: It is not changed.
        origin: File or name to begin errors with.
        seed: Replaces `random_seed`.

    Raises:
        ScenarioError: With one line that says what is wrong, where, what is allowed.
    """
    tree = dict(tree)
    if seed is not None:
        tree["random_seed"] = seed
    # The seed is needed for the draws, so it is checked before them.
    seed = load_typed(
        Scenario, {"random_seed": tree.get("random_seed", 0)}, origin
    ).random_seed
    values: dict[str, Any] = {}
    tree = add_clutter(tree, int(seed or 0), origin, values)
    drawn = draw_distributions(tree, int(seed or 0), origin, values)
    scenario: Scenario = load_typed(Scenario, drawn, origin)
    _play_messages(scenario, origin)
    check_scenario(scenario, origin)
    _draw_positions(scenario, origin, values)
    return Drawn(scenario, values)


def load_scenario(
    name: str | Path,
    *,
    seed: int | None = None,
    overrides: Iterable[str] = (),
) -> Scenario:
    """Load a scenario, draw what is random and check it.

    Args:
        name: Name of a scenario of the package, or path of a YAML file.
        seed: Replaces `random_seed`.
        overrides: `KEY=VALUE` each; the key dotted (`object.` is short for the picked
            object's entry), the value YAML.

    Raises:
        ScenarioError: With one line that says what is wrong, where, what is allowed.
    """
    return draw_scenario(load_tree(name, overrides), str(name), seed).scenario


def _play_messages(scenario: Scenario, origin: str) -> None:
    """Make the script of what is sent."""
    if scenario.messages is None:
        return
    if scenario.script:
        raise ScenarioError(f"{origin}: script: must be empty, the messages replace it")
    with scenario_errors(origin):
        num_joints = len(scenario.arm.home) if scenario.arm else 0
        scenario.script = message_script(scenario.messages, num_joints)


def _draw_positions(scenario: Scenario, origin: str, values: dict[str, Any]) -> None:
    """Draw where the objects without a position stand, clear of the others."""
    objects, pick = scenario.objects, scenario.task.pick
    homeless = [n for n, o in objects.items() if o.position is None and o.pose is None]
    # The picked object comes first: the others must not change where it stands.
    for names in (
        [n for n in homeless if n == pick],
        [n for n in homeless if n != pick],
    ):
        for name, p in _free_places(scenario, origin, names).items():
            objects[name].position = [float(x) for x in p]
            values |= {f"objects.{name}.position[{i}]": float(p[i]) for i in range(2)}


def _free_places(
    scenario: Scenario, origin: str, names: Iterable[str]
) -> dict[str, Vector]:
    """Draw places for some objects, clear of each other and of those that have one."""
    region, spacing = scenario.task.region, scenario.task.spacing
    uniform = UniformVectorX(np.array(region.min), np.array(region.max))
    generators: dict[str, RandomGenerator] = {
        name: key_generator(scenario.random_seed, f"objects.{name}.position")
        for name in names
    }
    fixed = [np.array(o.position) for o in scenario.objects.values() if o.position]

    def free_place(name: str, taken: list[Vector]) -> Vector | None:
        for _ in range(1000):
            p = np.asarray(uniform.Sample(generators[name]))
            if all(np.linalg.norm(p - other) > spacing for other in taken):
                return p
        return None

    for _ in range(20):  # the places of the first may leave none for the last
        places: dict[str, Vector] = {}
        for name in names:
            p = free_place(name, [*fixed, *places.values()])
            if p is None:
                break
            places[name] = p
        else:
            return places
    raise ScenarioError(
        f"{origin}: task.region: no free place for {name!r}; make it larger"
    )
