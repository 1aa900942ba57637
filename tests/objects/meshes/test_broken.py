"""Broken files of objects end in one line that names the file, whatever is broken."""

import json

import numpy as np
import pytest
from helpers import check_reads_or_refuses, damaged
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.meshes import pieces
from drake_srg.objects.meshes.files import MeshFile, read_mesh
from drake_srg.objects.meshes.links import read_link
from objects.meshes.made_meshes import (
    NEEDS_TRIMESH,
    box,
    gltf,
    write_glb,
    write_obj,
    write_stl,
)

pytestmark = NEEDS_TRIMESH
BOX = box([0.04, 0.05, 0.06])
CUT = "<cylinder radius='0.03' length='0.1'/>"
URDF = (
    "<?xml version='1.0' encoding='utf-8'?><robot name='r' xmlns:drake='d'>"
    "<material name='m'><color rgba='1 0.5 0 1'/></material><link name='l'><inertial>"
    "<origin xyz='0 0 0.01' rpy='0 0 1'/><mass value='0.2'/><inertia ixx='2e-4' "
    "iyy='3e-4' izz='4e-4' ixy='0' ixz='0' iyz='0'/></inertial><visual><geometry>"
    f"{CUT}</geometry><material name='m'/></visual><collision><origin xyz='0 0 0.05'/>"
    f"<geometry>{CUT}</geometry><drake:proximity_properties><drake:mu_static "
    "value='0.3'/></drake:proximity_properties></collision></link></robot>"
)
SDF = (
    "<?xml version='1.0'?><sdf version='1.9'><model name='m'><link name='l'><inertial>"
    "<pose degrees='true'>0 0 0.01 0 0 30</pose><mass>0.2</mass><inertia>"
    "<ixx>2e-4</ixx><iyy>3e-4</iyy><izz>4e-4</izz></inertia></inertial>"
    "<visual name='v'><geometry><sphere><radius>0.03</radius></sphere></geometry>"
    "<material><diffuse>1 0 0.5</diffuse></material></visual>"
    "<collision name='c'><pose>0 0 0 0 0 0</pose>"
    "<geometry><box><size>0.04 0.05 0.06</size></box></geometry>"
    "<surface><friction><ode><mu>0.3</mu><mu2>0.2</mu2></ode></friction></surface>"
    "</collision></link></model></sdf>"
)


def content_of(suffix, folder):
    """Return the bytes of a small valid file."""
    path = folder / f"valid{suffix}"
    match suffix:
        case ".obj":
            write_obj(path, BOX, "mtllib a.mtl\nusemtl red\nvt 0 0\nvn 0 0 1")
        case ".stl":
            write_stl(path, BOX)
        case ".bin.stl":
            import trimesh

            path.write_bytes(trimesh.Trimesh(*BOX).export(file_type="stl"))
        case ".glb":
            write_glb(path, *gltf(BOX, material={}))
        case ".gltf":
            tree, content = gltf(BOX, node={"scale": [1, 1, 1]}, material={})
            tree["buffers"][0]["uri"] = "valid.bin"
            (folder / "valid.bin").write_bytes(content)
            path.write_text(json.dumps(tree))
    return path.read_bytes()


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".bin.stl", ".glb", ".gltf"])
@settings(max_examples=60)
@given(data=st.data())
def test_a_broken_mesh(tmp_path_factory, suffix, data):
    folder = tmp_path_factory.mktemp("mesh")
    content = data.draw(damaged(content_of(suffix, folder)))
    path = folder / f"broken.{suffix.rpartition('.')[2]}"
    path.write_bytes(content)
    file = MeshFile(path, np.ones(3))
    check_reads_or_refuses(lambda _: read_mesh(file, []), path)


@settings(max_examples=100)
@given(data=st.data())
def test_a_broken_material(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("mesh")
    path = folder / "a.obj"
    write_obj(path, BOX, "mtllib a.mtl\nusemtl red")
    content = b"newmtl red\nKd 0.8 0.2 0.1\nmap_Kd a.png\nd 1\n"
    (folder / "a.mtl").write_bytes(data.draw(damaged(content)))
    (folder / "a.png").write_bytes(data.draw(st.binary(max_size=40)))
    assert read_mesh(MeshFile(path, np.ones(3)), []).solid.is_volume


@pytest.mark.parametrize(("name", "text"), [("a.urdf", URDF), ("a.sdf", SDF)])
@settings(max_examples=100)
@given(data=st.data())
def test_a_broken_link(tmp_path_factory, name, text, data):
    path = tmp_path_factory.mktemp("xml") / name
    path.write_bytes(data.draw(damaged(text.encode())))
    check_reads_or_refuses(read_link, path)


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".glb", ".sdf", ".urdf"])
@settings(max_examples=10)  # each takes 0.1 s
@given(data=st.data())
def test_a_broken_object(tmp_path_factory, suffix, data):
    """Through conversion and Drake's parser."""
    folder = tmp_path_factory.mktemp("object")
    texts = {".sdf": SDF.encode(), ".urdf": URDF.encode()}
    content = texts.get(suffix) or content_of(suffix, folder)
    path = folder / f"broken{suffix}"
    path.write_bytes(data.draw(damaged(content)))
    config = ObjectConfig(model=str(path), mass=0.2)
    with pytest.MonkeyPatch.context() as patch:  # CoACD takes seconds
        patch.setattr(pieces, "_cut", lambda mesh, most: [np.asarray(mesh.vertices)])
        check_reads_or_refuses(lambda _: object_facts("thing", config), path)


@pytest.mark.parametrize(
    "name", ["a.obj", "a.stl", "a.glb", "a.gltf", "a.urdf", "a.sdf"]
)
def test_a_folder_or_an_empty_file(tmp_path, name):
    path = tmp_path / name
    read = read_link if name[2:] in ("urdf", "sdf") else read_file
    path.mkdir()
    with pytest.raises(ScenarioError, match=rf"{name}: cannot be read: Is a directory"):
        read(path)
    path.rmdir()
    path.write_bytes(b"")
    with pytest.raises(ScenarioError, match=name):
        read(path)


def read_file(path):
    return read_mesh(MeshFile(path, np.ones(3)), [])
