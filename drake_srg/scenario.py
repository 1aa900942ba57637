"""What is simulated: a scenario file and the dataclasses that it fills.

A scenario is YAML in Drake's own schema where Drake has one (plant, simulator, scene
graph, model directives, cameras). `base: NAME` lays a file over another. Any numeric
field may be one of Drake's distributions, drawn from `random_seed`.
"""

import dataclasses as dc
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.schema import Transform, UniformVectorX
from pydrake.geometry import SceneGraphConfig
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig

from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.distributions import draw_distributions, key_generator
from drake_srg.disturbances import Force, Push, Topple
from drake_srg.errors import ScenarioError, scenario_errors
from drake_srg.gripper.drivers import GripperDriver
from drake_srg.planning.config import PlannerConfig
from drake_srg.planning.messages import MessagesConfig, message_script
from drake_srg.planning.scripted import ScriptStep
from drake_srg.scenario_checks import check_scenario
from drake_srg.types import Box, Cylinder, Sphere, positive
from drake_srg.yaml_loading import load_typed, merge, parse_yaml, set_key

SCENARIOS = Path(__file__).parent / "scenarios"


@dc.dataclass(kw_only=True)
class ColorRangeConfig:
    """Colours by which the localizer finds an object, bounds inclusive."""

    lower: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )
    upper: list[float] = dc.field(
        default_factory=lambda: [360.0, 1.0, 1.0], metadata={"length": 3}
    )
    # hsv: hue in degrees (lower above upper wraps through red), saturation and value
    # 0 .. 1. rgb: 0 .. 1.
    space: str = dc.field(default="hsv", metadata={"among": ("hsv", "rgb")})


@dc.dataclass(kw_only=True)
class SoftConfig:
    """What a soft object is made of: an elastic, isotropic solid.

    The defaults are those of a dry kitchen sponge of flexible polyurethane foam, 30
    kg/m³ (Gibson and Ashby, Cellular Solids, 2nd ed., ch. 5, for open cells): modulus
    (30 / 1200)² of the solid's 45 MPa, Poisson's ratio a third.
    """

    youngs_modulus: float = dc.field(default=28.0e3, metadata=positive())  # Pa
    # Linear tetrahedra lock as this comes near 0.5.
    poissons_ratio: float = dc.field(default=0.33, metadata={"ge": 0.0, "le": 0.45})
    # Viscosity over stiffness [s]: loss factor over angular frequency.
    damping: float = dc.field(default=0.01, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class ObjectConfig:
    """An object that can be moved; at the start it stands upright on the table."""

    # Model with one link, or else `shape`. Where the link has one collision geometry, a
    # cylinder, box or ball around its origin, the localizer and the planner know that
    # shape. Any other object is one that they neither see nor pick; its origin is under
    # it, on the table.
    model: str | None = None
    shape: Cylinder | Box | Sphere | None = None
    # Makes a `shape`, a box, of finite elements; a script can pick it, the planner not.
    # The plant must have the contact approximation `sap` and steps of up to 5 ms.
    soft: SoftConfig | None = None
    # kg; with a model, null keeps the model's.
    mass: float | None = dc.field(default=None, metadata=positive())
    # Coulomb friction coefficient; with a model, null keeps the model's.
    friction: float | None = dc.field(default=None, metadata={"ge": 0.0})
    # Edge length of the facets that stand for round geometry in contact [m]; null keeps
    # the model's, or takes 0.3 of a shape's radius. For a soft object, longest edge of
    # the cells that are cut into elements; null takes a quarter of its least extent.
    resolution: float | None = dc.field(default=None, metadata=positive())
    # Hydroelastic modulus [Pa]; null keeps the model's, or takes 50 MPa for a shape. A
    # light object rattles on a stiff support where contact is too stiff for the step.
    modulus: float | None = dc.field(default=None, metadata=positive())
    # Red, green, blue 0 .. 1: what a `shape` is painted with and what the localizer
    # looks for.
    color: list[float] = dc.field(
        default_factory=lambda: [0.8, 0.1, 0.1],
        metadata={"length": 3, "ge": 0.0, "le": 1.0},
    )
    # What the localizer looks for, where `color` and its default tolerance do not do.
    color_range: ColorRangeConfig | None = None
    # [x, y] of the centre on the table, in world [m]; null draws it in `task.region`.
    position: list[float] | None = dc.field(default=None, metadata={"length": 2})
    yaw: float = 0.0  # rad, about the vertical
    # Where the object is at the start, in world or in the frame `base_frame` of a model
    # among the directives, instead of `position` and `yaw`: lying, on something, in the
    # hand.
    pose: Transform | None = None
    present: bool = True  # false leaves the object out
    covered: bool = False  # true puts a lid over it that hides it from the cameras


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
    # Where objects without a position may stand.
    region: RegionConfig = dc.field(default_factory=RegionConfig)


@dc.dataclass(kw_only=True)
class LocalizerConfig:
    """How objects are found in images."""

    # Names in `cameras`, each once.
    cameras: list[str] = dc.field(default_factory=list)
    # Smallest blob [pixels].
    min_area: int = dc.field(default=50, metadata={"ge": 1})
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
    # The top on which objects stand, of a table among the directives.
    table: TableConfig = dc.field(default_factory=TableConfig)
    objects: dict[str, ObjectConfig] = dc.field(default_factory=dict)
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


def list_scenarios() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return sorted(path.stem for path in SCENARIOS.glob("*.yaml"))


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
    tree = _load_tree(Path(name) if str(name).endswith(".yaml") else _builtin(name))
    for override in overrides:
        key, equals, value = override.partition("=")
        if not (key and equals):
            raise ScenarioError(f"--set {override}: must be KEY=VALUE")
        if key.split(".")[0] == "object":
            task = tree.get("task")
            picked = task.get("pick") if isinstance(task, dict) else None
            if not (picked and isinstance(picked, str)):
                raise ScenarioError(f"--set {key}: the scenario picks no object")
            key = f"objects.{picked}{key.removeprefix('object')}"
        set_key(tree, key, parse_yaml(f"value: {value}", f"--set {key}")["value"])
    origin = str(name)
    if seed is not None:
        tree["random_seed"] = seed
    # The seed is needed for the draws, so it is checked before them.
    seed = load_typed(
        Scenario, {"random_seed": tree.get("random_seed", 0)}, origin
    ).random_seed
    scenario: Scenario = load_typed(
        Scenario, draw_distributions(tree, int(seed or 0), origin), origin
    )
    _play_messages(scenario, origin)
    check_scenario(scenario, origin)
    _draw_positions(scenario, origin)
    return scenario


def _builtin(name: str | Path) -> Path:
    if name not in list_scenarios():
        raise ScenarioError(
            f"scenario {str(name)!r} is unknown; allowed: {', '.join(list_scenarios())}"
            " or a path that ends in .yaml"
        )
    return SCENARIOS / f"{name}.yaml"


def _load_tree(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeError:
        raise ScenarioError(f"{path}: cannot be read: not text in UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: of a null in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    tree = parse_yaml(text, path.name)
    if tree is None:
        tree = {}
    if not isinstance(tree, dict):
        raise ScenarioError(f"{path.name}: must be a mapping of keys to values")
    base = tree.pop("base", None)
    if base is None:
        return tree
    if not isinstance(base, str):
        raise ScenarioError(f"{path.name}: base: must be a scenario's name or path")
    base_path = path.parent / base if base.endswith(".yaml") else _builtin(base)
    if base_path in seen:
        raise ScenarioError(f"{path.name}: base: {base} leads back to itself")
    merged: dict[str, Any] = merge(_load_tree(base_path, (*seen, path)), tree)
    return merged


def _play_messages(scenario: Scenario, origin: str) -> None:
    """Make the script of what is sent."""
    if scenario.messages is None:
        return
    if scenario.script:
        raise ScenarioError(f"{origin}: script: must be empty, the messages replace it")
    with scenario_errors(origin):
        num_joints = len(scenario.arm.home) if scenario.arm else 0
        scenario.script = message_script(scenario.messages, num_joints)


def _draw_positions(scenario: Scenario, origin: str) -> None:
    """Draw where the objects without a position stand, clear of the others."""
    taken = [np.array(o.position) for o in scenario.objects.values() if o.position]
    region = scenario.task.region
    uniform = UniformVectorX(np.array(region.min), np.array(region.max))
    # The picked object comes first: the others must not change where it stands.
    objects = sorted(
        scenario.objects.items(), key=lambda item: item[0] != scenario.task.pick
    )
    for name, obj in objects:
        if obj.position is not None or obj.pose is not None:
            continue
        generator: RandomGenerator = key_generator(
            scenario.random_seed, f"objects.{name}.position"
        )
        for _ in range(1000):
            position = np.asarray(uniform.Sample(generator))
            # 0.15 m leaves room for an open finger between two objects.
            if all(np.linalg.norm(position - other) > 0.15 for other in taken):
                break
        else:
            raise ScenarioError(
                f"{origin}: task.region: no free place for {name!r}; make it larger"
            )
        obj.position = [float(x) for x in position]
        taken.append(position)
