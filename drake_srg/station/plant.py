"""The plant of a scenario: all models in their places."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    GetScopedFrameByName,
    LoadModelDirectivesFromString,
    Parser,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from drake_srg import parsing
from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.objects.models import (
    AddObject,
    SetDefaultObjectPose,
    X_FO_start,
    simple_shape,
)
from drake_srg.objects.slides import SetSlideGains
from drake_srg.scenario import Scenario
from drake_srg.station.drops import Drops
from drake_srg.station.occlusion import AddCard
from drake_srg.station.preflight import check_constraints, flat_directives, model_files

_LID = "package://drake_srg/sdf/lid.sdf"


@scenario_errors()
def AddPlant(
    builder: DiagramBuilder, scenario: Scenario
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add the finalized plant with all models of a scenario to a diagram.

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
    if scenario.arm is not None:
        arm = plant.GetModelInstanceByName("arm")
        scenario.arm.prepare_plant(plant, arm)
    if scenario.gripper is not None:
        gripper = plant.GetModelInstanceByName("gripper")
        scenario.gripper.prepare_plant(plant, gripper)
    for name in scenario.slides:
        SetSlideGains(plant, name)
    if scenario.arm is not None and scenario.arm.weightless:
        plant.set_gravity_enabled(arm, False)
    plant.Finalize()
    if scenario.arm is not None:
        plant.SetDefaultPositions(arm, scenario.arm.home)
    filter_contacts(scene_graph, scenario.ignored_contacts)
    return plant, scene_graph


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
    """A scenario's directives, as the key of caches of plants made from them alone."""

    directives: str  # YAML; includes those of other files
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

    It serves kinematics and gravity. Do not change it: all callers share it as long as
    the files stay the same, because Drake needs 20 ms to read even a small model.

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
    if scenario.arm is not None:
        arm = plant.GetModelInstanceByName("arm")
        plant.SetPositions(context, arm, scenario.arm.home)
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
