"""A scenario's plant: models, objects, cards that hide them, and checks of constraints.

Some constraints of models are not supported by every solver. Drake refuses some of
these in the first step, logs a warning for others, and silently ignores the rest.
`check_constraints` reports all of them before the plant is built.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import itertools
import re
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    CollisionFilterDeclaration,
    GeometrySet,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.geometry import Box as DrakeBox
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import (
    FlattenModelDirectives,
    GetScopedFrameByName,
    LoadModelDirectivesFromString,
    ModelDirectives,
    PackageMap,
    Parser,
)
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
)
from pydrake.systems.framework import DiagramBuilder

from drake_srg import parsing
from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.common.systems import NEWER_DRAKE, takes_loop_constraints
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.models import (
    AddObject,
    SetDefaultObjectPose,
    X_FO_start,
    simple_shape,
)
from drake_srg.objects.slides import SetSlideGains
from drake_srg.parsing import configure_parser
from drake_srg.scenario.schema import (
    RobotArm,
    Scenario,
    is_continuous,
    robot_arms,
)
from drake_srg.types import Vector


class Drops:
    """Heights at which objects with `drop` start, in the order of the objects.

    Args:
        table_height: In world [m].
    """

    def __init__(self, table_height: float) -> None:
        self._table = table_height
        self._boxes: list[tuple[Vector, Vector]] = []

    def X_WO_start(
        self, name: str, config: ObjectConfig, X_WO: RigidTransform
    ) -> RigidTransform:
        """Return the pose at which an object starts.

        The box around the object clears the table and the boxes of earlier falling
        objects. It may overlap objects that stand on the table.

        Args:
            name: The object's name, for error messages.
            config: The object, with `drop`.
            X_WO: Its pose [m]; the height is ignored.

        Raises:
            ScenarioError: If its model cannot be read.
        """
        assert config.drop is not None
        facts = object_facts(name, config)
        ends = np.array([facts.low, facts.high])
        choices = itertools.product((0, 1), repeat=3)
        corners = np.array([ends[choice, range(3)] for choice in choices])
        p_W = corners @ X_WO.rotation().matrix().T + X_WO.translation()
        low, high = p_W.min(axis=0), p_W.max(axis=0)
        floor = self._table
        # From the lowest box up: an object may fit under one that starts high.
        for below, above in sorted(self._boxes, key=lambda box: box[0][2]):
            beside = np.any((below[:2] > high[:2]) | (above[:2] < low[:2]))
            room = below[2] - floor
            if not beside and room < config.drop + high[2] - low[2]:
                floor = max(floor, above[2])
        rise = np.array([0.0, 0.0, floor + config.drop - low[2]])
        self._boxes.append((low + rise, high + rise))
        return RigidTransform(X_WO.rotation(), X_WO.translation() + rise)


# Distance from the camera to the card, over that to the object. This is near enough to
# the camera that an arm on the table does not touch the card.
_SHARE_OF_DISTANCE = 0.3
_GREY = [0.35, 0.35, 0.35, 1.0]


def AddCard(plant: MultibodyPlant, scenario: Scenario, name: str, p_WO: Vector) -> None:
    """Add a card that hides part of an object, before the plant is finalized.

    The card can be seen but not touched.

    Args:
        plant: A plant registered with a scene graph.
        scenario: The scenario. The card hides the object from the localizer's first
            camera.
        name: An object with an `occlusion`.
        p_WO: Position of the object in world [m], shape (3,).

    Raises:
        ScenarioError: If the localizer's first camera is not fixed in world, or the
            object does not have a simple shape.
    """
    config = scenario.objects[name].occlusion
    key = f"objects.{name}.occlusion"
    if not scenario.localizer.cameras:
        raise ScenarioError(f"{key}: needs at least one camera in localizer.cameras")
    camera = scenario.cameras[scenario.localizer.cameras[0]]
    if camera.X_PB.base_frame not in (None, "world"):
        raise ScenarioError(
            f"{key}: needs a first localizer camera that is fixed in world, got one in "
            f"{camera.X_PB.base_frame}"
        )
    if config is None or config.share == 0.0:
        return
    p_WC = camera.X_PB.GetDeterministicValue().translation()
    sight = _SHARE_OF_DISTANCE * (p_WO - p_WC)
    R_WCard = _facing(sight, config.direction)
    radius = _SHARE_OF_DISTANCE * _half_width(scenario, name)  # projected onto the card
    side = 2.4 * radius  # wide enough to hide the whole object
    aside = radius * (1.0 - 2.0 * config.share) + 0.5 * side
    X_WCard = RigidTransform(R_WCard, p_WC + sight + aside * R_WCard.matrix()[:, 0])
    plant.RegisterVisualGeometry(
        plant.world_body(), X_WCard, DrakeBox(side, side, 1e-3), f"card_{name}", _GREY
    )


def _facing(sight: Vector, direction: float) -> RotationMatrix:
    """Return the axes of a card: z along a line of sight, x closest to a direction."""
    z = sight / np.linalg.norm(sight)
    x = np.array([np.cos(direction), np.sin(direction), 0.0])
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z]))


def _half_width(scenario: Scenario, name: str) -> float:
    """Return half the width of an upright object [m]."""
    shape = simple_shape(name, scenario.objects[name])
    if shape is None:
        raise ScenarioError(
            f"objects.{name}.occlusion: needs an object of one simple shape"
        )
    return shape.upright_radius


# Elements that define constraints, by the suffix of the model's file.
_ELEMENTS = {
    ".sdf": ("drake:mimic", "drake:ball_constraint", "drake:tendon_constraint"),
    ".urdf": ("mimic", "drake:ball_constraint", "drake:tendon_constraint"),
    ".xml": ("connect",),  # MuJoCo
}
_SAP = "discrete_contact_approximation sap, similar or lagged"


def check_constraints(scenario: Scenario) -> None:
    """Check that the scenario's solver supports all constraints of its models.

    Raises:
        ScenarioError: If it does not. The message names the model, the solver and the
            alternatives.
    """
    for model, path in model_files(scenario):
        text = re.sub("<!--.*?-->", "", path.read_text("utf-8"), flags=re.DOTALL)
        found = [e for e in _ELEMENTS.get(path.suffix, ()) if _count(e, text)]
        for element, why in (
            *_ignored(path.suffix, text),
            *((element, _refused(element, scenario)) for element in found),
        ):
            if why:
                raise ScenarioError(
                    f"directives: {model}: {path.name} has <{element}>, {why}"
                )


def _refused(element: str, scenario: Scenario) -> str:
    """Return why the solver refuses an element, with the alternatives, or ""."""
    if is_continuous(scenario):
        discrete = f"plant_config.time_step greater than 0.0 with {_SAP}"
        if element.endswith("tendon_constraint"):
            return f"which integrator cenic refuses (allowed: {discrete})"
        if element.endswith("mimic") or takes_loop_constraints():
            return ""
        return (
            "which integrator cenic refuses on this Drake (allowed: <drake:mimic>, "
            f"{NEWER_DRAKE}, or {discrete})"
        )
    if scenario.plant_config.discrete_contact_approximation == "tamsi":
        return f"which tamsi does not support (allowed: {_SAP})"
    return ""


def _ignored(suffix: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield elements that Drake silently ignores, with the alternatives."""
    why = "which Drake ignores (allowed: {})"
    if suffix == ".urdf" and _count("drake:mimic", text):
        yield "drake:mimic", why.format("<mimic>")
    if suffix == ".sdf":
        outside = re.sub(r"<axis\b.*?</axis>", "", text, flags=re.DOTALL)
        effective = _count("drake:mimic", outside)
        for element in ("mimic", "drake:mimic"):
            if _count(element, text) > effective:
                yield element, why.format("<drake:mimic> directly in the joint")


def _count(element: str, text: str) -> int:
    return len(re.findall(rf"<{element}\b", text))


def model_files(scenario: Scenario) -> Iterator[tuple[str, Path]]:
    """Yield name and file of each model in the directives, and of included models.

    Files that cannot be found are left out; the parser reports them.
    """
    plant = MultibodyPlant(time_step=0.0)  # the parser does not keep it alive
    parser = Parser(plant)
    configure_parser(parser)
    try:
        flat = flat_directives(scenario, parser)
    except RuntimeError:
        return
    for directive in flat.directives:
        if (model := directive.add_model) is not None:
            for path in _with_includes(model.file, parser.package_map()):
                yield model.name, path


def flat_directives(scenario: Scenario, parser: Parser) -> ModelDirectives:
    """Return a scenario's directives, with included files replaced by their contents.

    Raises:
        RuntimeError: If Drake cannot read a file.
    """
    return FlattenModelDirectives(
        ModelDirectives(directives=scenario.directives), parser.package_map()
    )


def _with_includes(url: str, packages: PackageMap) -> Iterator[Path]:
    try:
        path = Path(packages.ResolveUrl(url))
        text = path.read_text("utf-8")
    except (RuntimeError, OSError, UnicodeError):
        return
    yield path
    for included in re.findall(
        r"<include>.*?<uri>\s*(\S+?)\s*</uri>.*?</include>", text, flags=re.DOTALL
    ):
        yield from _with_includes(included, packages)


_LID = "package://drake_srg/sdf/lid.sdf"


# Depth below the table's top, deeper than any floor, and size of the catch floor, more
# than anything slides [m].
_CATCH_DEPTH, _CATCH_SIDE = 5.0, 10_000.0


def AddCatchFloor(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Add an invisible floor far below, before the plant is finalized.

    Otherwise, objects that leave the cell would fall until numbers overflow.
    """
    properties = ProximityProperties()
    # Soft and damped: an object that arrives at 10 m/s rebounds at 1 cm/s at most.
    AddCompliantHydroelasticProperties(_CATCH_SIDE, 1e5, properties)
    AddContactMaterial(
        dissipation=100.0, friction=CoulombFriction(1.0, 1.0), properties=properties
    )
    top = scenario.table.height - _CATCH_DEPTH
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform([0.0, 0.0, top - 0.5]),
        DrakeBox(_CATCH_SIDE, _CATCH_SIDE, 1.0),
        "catch",
        properties,
    )


@scenario_errors()
def AddPlant(
    builder: DiagramBuilder, scenario: Scenario, *, catch: bool = True
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add the finalized plant with all models of a scenario to a diagram.

    Args:
        builder: The diagram's builder.
        scenario: The scenario.
        catch: Whether to add a floor far below that catches objects.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    check_constraints(scenario)
    plant, scene_graph = AddMultibodyPlant(
        plant_config=scenario.plant_config,
        scene_graph_config=scenario.scene_graph_config,
        builder=builder,
    )
    AddDirectives(plant, scenario)
    AddObjects(plant, scenario)
    if catch:
        AddCatchFloor(plant, scenario)
    robots = robot_arms(scenario)
    for robot in robots:
        _check_models(plant, robot)
        with robot.named_errors():
            if robot.arm is not None:
                arm = plant.GetModelInstanceByName(robot.arm_model)
                robot.arm.prepare_plant(plant, arm)
            if robot.gripper is not None:
                gripper = plant.GetModelInstanceByName(robot.gripper_model)
                robot.gripper.prepare_plant(plant, gripper)
    for name in scenario.slides:
        SetSlideGains(plant, name)
    plant.Finalize()
    for robot in robots:
        if robot.arm is not None:
            with robot.named_errors():
                arm = plant.GetModelInstanceByName(robot.arm_model)
                robot.arm.SetGains(plant, arm)
    filter_contacts(scene_graph, scenario.ignored_contacts)
    return plant, scene_graph


def _check_models(plant: MultibodyPlant, robot: RobotArm) -> None:
    """Check that the models of one of several arms exist.

    Raises:
        ScenarioError: If a model is missing.
    """
    for key, model, config in (
        ("arm", robot.arm_model, robot.arm),
        ("gripper", robot.gripper_model, robot.gripper),
    ):
        if robot.name and config and not plant.HasModelInstanceNamed(model):
            raise ScenarioError(
                f"{robot.key}{key}: needs a model named {model} in directives"
            )


def check_driven(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Check that every model with motors has a driver; without one, it would go limp.

    Raises:
        ScenarioError: If a model has none.
    """
    driven = set(scenario.slides)
    for robot in robot_arms(scenario):
        driven |= {robot.arm_model} if robot.arm else set()
        driven |= {robot.gripper_model} if robot.gripper else set()
    motors = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    for name in (plant.GetModelInstanceName(m.model_instance()) for m in motors):
        if name not in driven:
            raise ScenarioError(
                f"directives: {name}: has motors that nothing drives (allowed: a model "
                "named arm or gripper with the key of that name, NAME or NAME.gripper "
                "of arms, or one in slides)"
            )


def filter_contacts(scene_graph: SceneGraph, pairs: Sequence[Sequence[str]]) -> None:
    """Filter out contact between pairs of geometries.

    Args:
        scene_graph: The scene graph that holds the geometries.
        pairs: Pairs of name patterns; see `Scenario.ignored_contacts`.

    Raises:
        ScenarioError: If a pattern matches no collision geometry.
    """
    inspector = scene_graph.model_inspector()
    geometries = inspector.GetAllGeometryIds(Role.kProximity)

    def named(pattern: str) -> GeometrySet:
        found = [g for g in geometries if fnmatchcase(inspector.GetName(g), pattern)]
        if not found:
            raise ScenarioError(
                f"ignored_contacts: no collision geometry matches {pattern!r}"
            )
        return GeometrySet(found)

    for first, second in pairs:
        scene_graph.collision_filter_manager().Apply(
            CollisionFilterDeclaration().ExcludeBetween(named(first), named(second))
        )


def AddDirectives(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Add all models of a scenario except its objects to a plant.

    Raises:
        ScenarioError: If a directive cannot be processed.
    """
    try:
        parsing.AddDirectives(plant, scenario.directives)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:300]
        raise ScenarioError(f"directives: {reason}") from None


@dc.dataclass(frozen=True)
class Models:
    """A scenario's directives, as a cache key for plants made from directives alone."""

    directives: str  # YAML; included files are replaced by their contents
    changed: tuple[int, ...]  # times at which the models' files were changed [ns]

    @classmethod
    def of(cls, scenario: Scenario) -> Models:
        """Return the models of a scenario.

        Raises:
            ScenarioError: If a file of directives cannot be read.
        """
        parser = Parser(MultibodyPlant(time_step=0.0))
        parsing.configure_parser(parser)
        with scenario_errors("directives"):
            directives = yaml_dump_typed(flat_directives(scenario, parser))
            changed = (path.stat().st_mtime_ns for _, path in model_files(scenario))
            return cls(directives, tuple(changed))

    @scenario_errors("directives")
    def add_to(self, plant: MultibodyPlant) -> None:
        """Add the models to a plant.

        Raises:
            ScenarioError: If a directive cannot be processed.
        """
        directives = LoadModelDirectivesFromString(self.directives).directives
        parsing.AddDirectives(plant, directives)


def MakeModelsPlant(scenario: Scenario) -> MultibodyPlant:
    """Return a finalized plant of a scenario's models, without objects and geometry.

    It serves kinematics and gravity. Do not change it: as long as the files stay the
    same, all callers share it, because Drake needs 20 ms to read even a small model.

    Raises:
        ScenarioError: If a directive cannot be processed.
    """
    return _models_plant(Models.of(scenario))


@functools.lru_cache(maxsize=8)
def _models_plant(models: Models) -> MultibodyPlant:
    plant = MultibodyPlant(time_step=0.0)
    models.add_to(plant)
    plant.Finalize()
    return plant


def AddObjects(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Add a scenario's objects, their lids and cards, and the marker of the goal.

    Raises:
        ScenarioError: If an object cannot be added or its base frame is unknown.
    """
    height = scenario.table.height
    dropped = Drops(height)
    for name, config in scenario.objects.items():
        X_WO = X_FO_start(config, simple_shape(name, config), height)
        if config.pose is not None and config.pose.base_frame not in (None, "world"):
            X_WO = _X_WF_start(scenario, name, config.pose.base_frame) @ X_WO
        if config.drop is not None:
            X_WO = dropped.X_WO_start(name, config, X_WO)
        if config.present:
            model = AddObject(plant, name, config)
            SetDefaultObjectPose(plant, model, X_WO)
        if config.occlusion is not None and plant.geometry_source_is_registered():
            AddCard(plant, scenario, name, X_WO.translation())
        if config.covered:
            x, y = X_WO.translation()[:2]
            AddFixture(plant, f"lid_of_{name}", _LID, [x, y, height])
    if scenario.task.place.marker:
        AddFixture(
            plant,
            "goal_marker",
            scenario.task.place.marker,
            [*scenario.task.place.position, height],
        )


def _X_WF_start(scenario: Scenario, name: str, frame: str) -> RigidTransform:
    """Return the pose in world, at the start, of a frame of the directives' models."""
    plant = MakeModelsPlant(scenario)
    context = plant.CreateDefaultContext()
    for robot in robot_arms(scenario):
        if robot.arm is not None:
            arm = plant.GetModelInstanceByName(robot.arm_model)
            plant.SetPositions(context, arm, robot.arm.home)
    try:
        return GetScopedFrameByName(plant, frame).CalcPoseInWorld(context)
    except RuntimeError as error:
        raise ScenarioError(
            f"objects.{name}.pose.base_frame: {one_line(error)}"
        ) from None


def AddFixture(
    plant: MultibodyPlant, name: str, url: str, p_WF: Sequence[float]
) -> None:
    """Weld the model at `url` to the world as instance `name`, its origin at p_WF."""
    model = parsing.AddModel(plant, url, name)
    body = plant.get_body(plant.GetBodyIndices(model)[0])
    X_WF = RigidTransform(np.asarray(p_WF))
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WF)
