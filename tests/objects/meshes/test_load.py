import errno
import logging
import os
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.meshes import convert as conversion
from drake_srg.objects.meshes import load
from drake_srg.objects.meshes.load import (
    cache_folder,
    cached_folder,
    copy_folder,
    import_model,
    model_tree,
)
from drake_srg.objects.models import AddObject
from objects.meshes.made_meshes import (
    box,
    gltf,
    joined,
    write_gltf,
    write_obj,
    write_stl,
)
from objects.meshes.test_links import collision, urdf


class Maker:
    """Fills folders, and counts how often."""

    def __init__(self):
        self.count = 0

    def __call__(self, folder):
        self.count += 1
        (folder / "model.sdf").write_text("model")


def test_the_cache_follows_xdg(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "drake_srg" / "objects"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "drake_srg" / "objects"


def test_a_folder_is_made_once():
    make = Maker()
    folders = {cached_folder("key", make) for _ in range(3)}
    assert (len(folders), make.count) == (1, 1)
    assert (folders.pop() / "model.sdf").read_text() == "model"


@pytest.mark.parametrize("damage", ["change", "remove", "manifest", "no manifest"])
def test_a_damaged_folder_is_made_again(damage):
    make = Maker()
    folder = cached_folder("key", make)
    match damage:
        case "change":
            (folder / "model.sdf").write_text("mode")
        case "remove":
            (folder / "model.sdf").unlink()
        case "manifest":
            (folder / "files.json").write_text("[1]")
        case _:
            (folder / "files.json").unlink()
    assert (cached_folder("key", make) / "model.sdf").read_text() == "model"
    assert make.count == 2


def test_a_failure_leaves_nothing():
    def fail(folder):
        (folder / "model.sdf").write_text("half")
        raise ScenarioError("broken")

    with pytest.raises(ScenarioError, match="broken"):
        cached_folder("key", fail)
    assert list(cache_folder().iterdir()) == []


def test_the_faster_of_two_processes_wins():
    def make(folder):
        cached_folder("key", lambda other: (other / "a").write_text("first"))
        (folder / "a").write_text("second")

    assert (cached_folder("key", make) / "a").read_text() in ("first", "second")
    assert [path.name for path in cache_folder().iterdir()] == ["key"]


def test_a_cache_that_cannot_be_written_is_told(monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(ScenarioError, match=r"Permission denied \(set XDG_CACHE_HOME"):
        cached_folder("key", Maker())


def test_a_copy_has_no_manifest(tmp_path):
    copy_folder(cached_folder("key", Maker()), tmp_path / "copy")
    assert [path.name for path in (tmp_path / "copy").iterdir()] == ["model.sdf"]


# Two cubes far apart: the hull of both would fill the space between them.
PAIR = joined(box([0.02] * 3, [0, 0, 0.01]), box([0.02] * 3, [0.1, 0, 0.01]))


def test_each_part_of_a_mesh_is_a_piece_of_its_own(tmp_path):
    config = ObjectConfig(model=str(write_obj(tmp_path / "pair.obj", PAIR)))
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    AddObject(plant, "pair", config)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    geometries = [
        g
        for b in plant.GetBodyIndices(plant.GetModelInstanceByName("pair"))
        for g in plant.GetCollisionGeometriesForBody(plant.get_body(b))
    ]
    assert len(geometries) == 2
    for geometry in geometries:
        properties = inspector.GetProximityProperties(geometry)
        assert properties.HasProperty("hydroelastic", "hydroelastic_modulus")


@pytest.mark.parametrize("name", ["a.obj", "a.stl", "a.urdf", "a.sdf", "a.glb"])
def test_every_format_gives_the_same_object(tmp_path, name):
    vertices, faces = box([0.04, 0.05, 0.06], at=[0, 0, 0.03])
    path = tmp_path / name
    match path.suffix:
        case ".obj":
            write_obj(path, (vertices, faces))
        case ".stl":
            write_stl(path, (vertices, faces))
        case ".urdf":
            write_obj(tmp_path / "m.obj", (vertices, faces))
            urdf(path, collision("<mesh filename='m.obj'/>"))
        case ".sdf":
            write_obj(tmp_path / "m.obj", (vertices, faces))
            path.write_text(
                f"<sdf version='1.9'><model name='m'><link name='l'>{INERTIAL}"
                "<collision name='c'>"
                "<geometry><mesh><uri>m.obj</uri></mesh></geometry></collision></link>"
                "</model></sdf>"
            )
        case _:
            trimesh = pytest.importorskip("trimesh")  # of the extra `import`
            up = vertices[:, [0, 2, 1]] * (1, 1, -1)  # y is up
            trimesh.Trimesh(up, faces).export(path)
    facts = object_facts("a", ObjectConfig(model=str(path)))
    np.testing.assert_allclose(facts.size, [0.04, 0.05, 0.06], atol=1e-6)
    assert facts.low[2] == pytest.approx(0.0, abs=1e-6)
    mass = 0.1 if path.suffix == ".sdf" else 500.0 * 0.04 * 0.05 * 0.06
    assert facts.mass == pytest.approx(mass, rel=1e-5)


def test_mass_friction_and_modulus_override_the_files(tmp_path):
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3))
    config = ObjectConfig(model=str(path), mass=0.3, friction=0.2, modulus=1e6)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    model = AddObject(plant, "a", config)
    plant.Finalize()
    body = plant.get_body(plant.GetBodyIndices(model)[0])
    assert body.default_mass() == pytest.approx(0.3)
    (geometry,) = plant.GetCollisionGeometriesForBody(body)
    properties = scene_graph.model_inspector().GetProximityProperties(geometry)
    friction = properties.GetProperty("material", "coulomb_friction")
    assert friction.static_friction() == friction.dynamic_friction() == 0.2
    assert properties.GetProperty("hydroelastic", "hydroelastic_modulus") == 1e6


def test_our_models_are_taken_as_they_are(monkeypatch):
    monkeypatch.setattr(load, "import_model", None)  # nothing calls it
    for name in ("mug", "005_tomato_soup_can"):
        config = ObjectConfig(model=f"package://drake_srg/sdf/{name}.sdf")
        assert model_tree(name, config).find("model").get("name") == name


def test_a_caller_may_change_the_tree(tmp_path):
    config = ObjectConfig(model=str(write_obj(tmp_path / "a.obj", box([0.04] * 3))))
    model_tree("a", config).find("model").clear()
    assert model_tree("a", config).find("model/link") is not None


def test_a_conversion_is_kept(tmp_path, monkeypatch, caplog):
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3))
    calls, original = [], conversion.convert
    monkeypatch.setattr(
        conversion, "convert", lambda *args: (calls.append(args), original(*args))
    )
    with caplog.at_level(logging.WARNING, logger="drake_srg"):
        folder = import_model(path, 1.0, 32)
        assert "no mass in the file" in caplog.text
        caplog.clear()
        assert import_model(path, 1.0, 32) == folder
        assert not caplog.records
    assert len(calls) == 1
    assert import_model(path, 2.0, 32) != folder
    assert import_model(path, 1.0, 8) != folder
    assert len(calls) == 3


@pytest.mark.parametrize("changed", ["a.urdf", "m.obj", "m.mtl", "m.png"])
def test_a_change_of_any_file_is_noticed(tmp_path, changed):
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 0.8 0.2 0.1\nmap_Kd m.png\n")
    (tmp_path / "m.png").write_bytes(b"no picture")
    write_obj(tmp_path / "m.obj", box([0.04] * 3), head="mtllib m.mtl\nusemtl red")
    path = urdf(tmp_path / "a.urdf", collision("<mesh filename='m.obj'/>"))
    folder = import_model(path, 1.0, 32)
    with (tmp_path / changed).open("a") as file:
        file.write("\n")
    assert import_model(path, 1.0, 32) != folder


def test_two_folders_with_the_same_json_are_two_objects(tmp_path):
    """Their buffers differ, and so do a changed buffer and the one before."""
    models = {}
    for side in (0.04, 0.06):
        folder = tmp_path / str(side)
        folder.mkdir()
        models[side] = write_gltf(folder / "a.gltf", *gltf(box([side] * 3)))
    same = {path.read_bytes() for path in models.values()}
    assert len(same) == 1
    for side, path in models.items():
        facts = object_facts("a", ObjectConfig(model=str(path)))
        np.testing.assert_allclose(facts.size, [side] * 3, atol=1e-6)
    changed = models[0.04]
    write_gltf(changed, *gltf(box([0.05] * 3)))
    os.utime(changed, (1, 1))
    facts = object_facts("a", ObjectConfig(model=str(changed)))
    np.testing.assert_allclose(facts.size, [0.05] * 3, atol=1e-6)


def test_our_own_code_is_part_of_the_key(tmp_path, monkeypatch):
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3))
    folder = import_model(path, 1.0, 32)
    monkeypatch.setattr(load, "_own_digest", lambda: b"another version")
    assert import_model(path, 1.0, 32) != folder


@pytest.mark.parametrize("name", ["my things", "50%", "a#b?c", "rot-ü", "a&b<c"])
@pytest.mark.parametrize("home", [False, True])
def test_paths_may_have_any_character(tmp_path, monkeypatch, name, home):
    """Paths of an import, of an SDF that needs none, and of the cache."""
    folder = tmp_path / name
    folder.mkdir()
    if home:
        monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    write_obj(folder / "m a%20.obj", box([0.04] * 3))
    taken, uri = folder / "a.sdf", escape(f"file://{folder}/m a%20.obj")
    convex = "<drake:declare_convex/>"
    for content in (sdf_mesh(uri, convex), sdf_mesh("m a%20.obj", convex)):
        taken.write_text(content)
        assert object_facts("a", ObjectConfig(model=str(taken))).size[0] == 0.04
    made = folder / "made"
    copy_folder(import_model(folder / "m a%20.obj", 1.0, 32), made)
    for model in (folder / "m a%20.obj", made / "model.sdf"):
        facts = object_facts("a", ObjectConfig(model=str(model)))
        np.testing.assert_allclose(facts.size, [0.04] * 3, atol=1e-6)


def sdf_mesh(uri, more=""):
    return (
        f"<sdf version='1.9'><model name='m'><link name='l'>{INERTIAL}"
        "<collision name='c'>"
        f"<geometry><mesh><uri>{uri}</uri>{more}</mesh></geometry></collision></link></model></sdf>"
    )


INERTIAL = (
    "<inertial><mass>0.1</mass><inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz>"
    "</inertia></inertial>"
)
SURFACE = (
    "<surface><friction><ode><mu>0.12</mu><mu2>0.1</mu2></ode></friction></surface>"
)
MODULUS = "<drake:proximity_properties><drake:hydroelastic_modulus>1e6"
MODULUS += "</drake:hydroelastic_modulus></drake:proximity_properties>"


@pytest.mark.parametrize("taken", [True, False])
@pytest.mark.parametrize("more", [SURFACE, SURFACE + MODULUS])
@pytest.mark.parametrize("friction", [None, 0.3])
def test_the_friction_of_an_sdf_surface_is_kept(tmp_path, taken, more, friction):
    write_obj(tmp_path / "m.obj", box([0.04] * 3))
    text = sdf_mesh("m.obj", "<drake:declare_convex/>" if taken else "")
    path = tmp_path / "a.sdf"
    path.write_text(text.replace("</geometry>", "</geometry>" + more))
    config = ObjectConfig(model=str(path), friction=friction)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    AddObject(plant, "a", config)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    (geometry,) = inspector.GetAllGeometryIds(Role.kProximity)
    properties = inspector.GetProximityProperties(geometry)
    found = properties.GetProperty("material", "coulomb_friction")
    static, dynamic = (0.12, 0.1) if friction is None else (friction, friction)
    assert (found.static_friction(), found.dynamic_friction()) == (static, dynamic)
    if more != SURFACE:
        assert properties.GetProperty("hydroelastic", "hydroelastic_modulus") == 1e6


@pytest.mark.parametrize(
    ("elements", "problem"),
    [
        ("<include><uri>a</uri></include>", "<include> in its model"),
        ("<model name='n'><link name='k'/></model>", "<model> in its model"),
        ("<static>true</static>", "<static>: must be false"),
        ("<link name='k'/>", "must have one link, got 2"),
        ("<joint name='j' type='fixed'/>", "<joint> in its model"),
    ],
)
@pytest.mark.parametrize("more", ["", "<drake:declare_convex/>"])
def test_an_sdf_that_is_no_free_body_is_refused(tmp_path, more, elements, problem):
    write_obj(tmp_path / "m.obj", box([0.04] * 3))
    path = tmp_path / "a.sdf"
    path.write_text(sdf_mesh("m.obj", more).replace("</model>", elements + "</model>"))
    plant = MultibodyPlant(0.0)
    with pytest.raises(ScenarioError, match=rf"a\.sdf:? .*{problem}"):
        AddObject(plant, "a", ObjectConfig(model=str(path)))


@pytest.mark.parametrize("mass", [None, 0.4])
@pytest.mark.parametrize("size", ["<radius>0.03</radius>", "<radius>0,03</radius>"])
def test_an_sdf_without_mass_gets_one(tmp_path, mass, size):
    """Drake's default is 1 kg and 1 kg m²."""
    path = tmp_path / "a.sdf"
    sphere = f"<sphere>{size}</sphere>"
    text = sdf_mesh("m.obj").replace(INERTIAL, "")
    path.write_text(text.replace("<mesh><uri>m.obj</uri></mesh>", sphere))
    config = ObjectConfig(model=str(path), mass=mass)
    if "," in size:
        with pytest.raises(ScenarioError, match=r"radius: needs a finite number"):
            object_facts("a", config)
        return
    expected = 500.0 * 4 / 3 * np.pi * 0.03**3 if mass is None else mass
    assert object_facts("a", config).mass == pytest.approx(expected)


def test_only_meshes_are_scaled(tmp_path):
    path = urdf(tmp_path / "a.urdf", collision("<box size='40 40 40'/>"))
    config = ObjectConfig(model=str(path), scale=0.001)
    with pytest.raises(ScenarioError, match=r"^objects\.a\.model: .*scale: must be 1"):
        model_tree("a", config)


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        ("none.obj", "No such file"),
        ("none.sdf", "No such file"),
        ("package://nobody/a.obj", "nobody"),
        ("file:///none/a.obj", "No such file"),
        ("package://drake_srg/sdf/mug.stl", "mug.stl"),
    ],
)
def test_a_missing_file_is_told(model, problem):
    with pytest.raises(ScenarioError, match=rf"^objects\.a\.model: .*{problem}"):
        model_tree("a", ObjectConfig(model=model))
