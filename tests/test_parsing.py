from __future__ import annotations

from pathlib import Path

import pytest
from pydrake.geometry import Role
from pydrake.multibody.parsing import (
    LoadModelDirectivesFromString,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from drake_srg import parsing


def make_parser() -> Parser:
    return Parser(MultibodyPlant(0.0))


def fake_package(folder: Path) -> Path:
    package = folder / "drake_srg"
    package.mkdir(parents=True)
    return package


def add_models(folder: Path) -> Path:
    folder.mkdir()
    (folder / "package.xml").write_text("<package/>")
    return folder


def test_urls_resolve_from_a_checkout():
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parsing.configure_parser(parser)
    (model,) = parser.AddModelsFromUrl("package://drake_srg/sdf/srg.sdf")
    assert plant.GetModelInstanceName(model) == "srg"


def test_configuring_a_parser_twice_changes_nothing():
    parser = make_parser()
    parsing.configure_parser(parser)
    parsing.configure_parser(parser)
    assert parser.package_map().GetPath("drake_srg") == str(parsing.models_path())


def test_another_package_of_the_same_name_is_refused(tmp_path):
    parser = make_parser()
    parser.package_map().Add("drake_srg", str(add_models(tmp_path / "models")))
    with pytest.raises(ValueError, match="already maps package 'drake_srg'"):
        parsing.configure_parser(parser)


def test_a_wheel_carries_the_models_inside_the_package(tmp_path, monkeypatch):
    package = fake_package(tmp_path)
    inside = add_models(package / "models")
    add_models(tmp_path / "models")
    monkeypatch.setattr(parsing, "_PACKAGE", package)
    assert parsing.models_path() == inside


def test_a_checkout_has_the_models_beside_the_package(tmp_path, monkeypatch):
    beside = add_models(tmp_path / "models")
    monkeypatch.setattr(parsing, "_PACKAGE", fake_package(tmp_path))
    assert parsing.models_path() == beside


def test_the_error_for_missing_models_names_both_places(tmp_path, monkeypatch):
    package = fake_package(tmp_path)
    monkeypatch.setattr(parsing, "_PACKAGE", package)
    with pytest.raises(FileNotFoundError, match="models are missing") as error:
        parsing.models_path()
    assert str(package / "models") in str(error.value)
    assert str(tmp_path / "models") in str(error.value)


def contents(directives, add):
    """Return all that a plant and its scene graph hold, by name and with numbers."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    add(plant, LoadModelDirectivesFromString(directives))
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    inspector = scene_graph.model_inspector()
    geometries = [
        (
            inspector.GetName(g),
            str(inspector.GetShape(g)),
            inspector.GetPoseInFrame(g).GetAsMatrix4().tolist(),
            str(inspector.GetProximityProperties(g)),
            inspector.GetName(inspector.GetFrameId(g)),
        )
        for role in (Role.kProximity, Role.kIllustration)
        for g in inspector.GetAllGeometryIds(role)
    ]
    return (
        plant.GetTopologyGraphvizString(),
        plant.GetStateNames(),
        plant.GetActuatorNames(),
        plant.CalcMassMatrixViaInverseDynamics(context).tolist(),
        plant.GetPositionLowerLimits().tolist(),
        sorted(
            sorted(inspector.GetName(geometry) for geometry in pair)
            for pair in inspector.GetCollisionCandidates()
        ),
        geometries,
    )


def with_drake(plant, directives):
    parser = Parser(plant)
    parsing.configure_parser(parser)
    ProcessModelDirectives(ModelDirectives(directives=directives.directives), parser)


# Without those that take seconds to load (finer pads are the same text with other
# numbers) and YCB's objects, which `AddObject` reads as text anyway.
MODELS = sorted(
    path.stem
    for path in (parsing.models_path() / "sdf").glob("*.sdf")
    if not path.stem.startswith(("srg_fine", "0"))
)


@pytest.mark.parametrize("model", MODELS)
def test_models_read_as_text_are_those_that_drake_reads_as_files(model):
    url = f"package://drake_srg/sdf/{model}.sdf"
    directives = f"""directives:
- add_model: {{name: base, file: package://drake_srg/sdf/pedestal.sdf}}
- add_weld: {{parent: world, child: base::pedestal}}
- add_model: {{name: some_name, file: {url}}}
"""
    ours = contents(directives, lambda p, d: parsing.AddDirectives(p, d.directives))
    assert ours == contents(directives, with_drake)


def test_directives_with_more_than_a_name_are_drake_s():
    directives = """directives:
- add_model:
    name: arm
    file: package://drake_srg/sdf/iiwa14.sdf
    default_joint_positions: {joint_1: [0.5]}
- add_weld: {parent: world, child: arm::link_0, X_PC: {translation: [0, 0, 0.2]}}
"""
    plant = MultibodyPlant(0.0)
    parsing.AddDirectives(plant, LoadModelDirectivesFromString(directives).directives)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    assert plant.GetPositions(context)[0] == 0.5
    base = plant.GetFrameByName("link_0").CalcPoseInWorld(context)
    assert base.translation().tolist() == [0.0, 0.0, 0.2]


def test_a_name_that_is_taken_is_an_error_or_gets_a_suffix():
    plant = MultibodyPlant(0.0)
    url = "package://drake_srg/sdf/mug.sdf"
    names = [plant.GetModelInstanceName(parsing.AddModel(plant, url)) for _ in "ab"]
    assert names == ["mug", "mug_1"]
    with pytest.raises(RuntimeError, match="mug_1"):
        parsing.AddModel(plant, url, "mug_1")


def test_a_missing_model_is_drake_s_error():
    with pytest.raises(RuntimeError, match="nothing"):
        parsing.AddModel(MultibodyPlant(0.0), "package://drake_srg/sdf/nothing.sdf")


URDF = """<robot name="stick"><link name="rod"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"""


@pytest.mark.parametrize("make", [str, Path])
def test_a_model_is_added_by_its_path(tmp_path, monkeypatch, make):
    (tmp_path / "stick.urdf").write_text(URDF)
    plant = MultibodyPlant(0.0)
    absolute = parsing.AddModel(plant, make(tmp_path / "stick.urdf"))
    monkeypatch.chdir(tmp_path)
    relative = parsing.AddModel(plant, make("stick.urdf"), "second")
    assert plant.GetModelInstanceName(absolute) == "stick"
    assert plant.GetModelInstanceName(relative) == "second"
    with pytest.raises(FileNotFoundError, match=r"^stock\.urdf: no such file"):
        parsing.AddModel(plant, make("stock.urdf"))
