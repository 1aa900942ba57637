import json
import struct

import cv2
import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.files import MeshFile, read_mesh
from drake_srg.objects.meshes.sources import read_source
from objects.meshes.made_meshes import (
    NEEDS_TRIMESH,
    QUADS,
    box,
    gltf,
    write_glb,
    write_gltf,
    write_obj,
    write_stl,
)

pytestmark = NEEDS_TRIMESH
SIZE = [0.04, 0.06, 0.05]  # in glTF, y is up


def read(path):
    warnings = []
    mesh = read_mesh(MeshFile(path, np.ones(3)), warnings)
    return mesh.solid, [color for _, color in mesh.surfaces], warnings


def extents(path):
    return read(path)[0].extents


@pytest.mark.parametrize("uri", [None, "part.bin", "my part.bin", "50%25 ü.bin"])
def test_a_buffer_is_found_by_its_name(tmp_path, uri):
    path = write_gltf(tmp_path / "a.gltf", *gltf(box(SIZE)), uri)
    np.testing.assert_allclose(extents(path), [0.04, 0.05, 0.06], atol=1e-7)


def test_a_name_may_be_escaped(tmp_path):
    path = write_gltf(tmp_path / "a.gltf", *gltf(box(SIZE)), "my part.bin")
    path.write_text(path.read_text().replace("my part", "my%20part"))
    np.testing.assert_allclose(extents(path), [0.04, 0.05, 0.06], atol=1e-7)


def test_a_binary_file_is_read(tmp_path):
    path = write_glb(tmp_path / "a.glb", *gltf(box(SIZE)))
    np.testing.assert_allclose(extents(path), [0.04, 0.05, 0.06], atol=1e-7)


def test_a_sparse_accessor_counts(tmp_path):
    """Half of the corners move up, so that the box is 90 mm high instead of 60 mm."""
    vertices, faces = box(SIZE)
    tree, content = gltf((vertices, faces))
    upper = np.flatnonzero(vertices[:, 1] > 0)
    moved = vertices[upper] + [0, 0.03, 0]
    indices, values = upper.astype("<u2").tobytes(), moved.astype("<f4").tobytes()
    for part in (indices, values):
        view = {"buffer": 0, "byteOffset": len(content), "byteLength": len(part)}
        tree["bufferViews"].append(view)
        content += part
    tree["accessors"][0]["sparse"] = {
        "count": len(upper),
        "indices": {"bufferView": 2, "componentType": 5123},
        "values": {"bufferView": 3},
    }
    tree["buffers"][0]["byteLength"] = len(content)
    path = write_gltf(tmp_path / "a.gltf", tree, content)
    np.testing.assert_allclose(extents(path), [0.04, 0.05, 0.09], atol=1e-7)


@pytest.mark.parametrize("normalized", [False, True])
def test_quantized_positions_are_lengths(tmp_path, normalized):
    vertices, faces = box(SIZE)
    steps = np.round(vertices * 1e5).astype("<i2")
    scale = 1e-5 * (32767 if normalized else 1)
    more = {"extensionsRequired": ["KHR_mesh_quantization"]}
    tree, _ = gltf((vertices, faces), node={"scale": [scale] * 3}, **more)
    padded = np.hstack([steps, np.zeros((8, 1), "<i2")]).tobytes()  # a stride of 8
    content = padded + faces.astype("<u2").tobytes()
    tree["accessors"][0] |= {"componentType": 5122, "normalized": normalized}
    tree["bufferViews"][0] = {"buffer": 0, "byteLength": 64, "byteStride": 8}
    tree["bufferViews"][1]["byteOffset"] = 64
    tree["buffers"][0]["byteLength"] = len(content)
    path = write_gltf(tmp_path / "a.gltf", tree, content)
    np.testing.assert_allclose(extents(path), [0.04, 0.05, 0.06], rtol=1e-3)


@pytest.mark.parametrize(
    "node",
    [
        {"scale": [-1, 1, 1]},
        {"scale": [-1, -1, -1]},
        {"scale": [2, 2, 2], "matrix": None},
        {"rotation": [0, 0, 1, 0], "translation": [1, 2, 3]},
        {"matrix": np.diag([1, 1, -1, 1]).ravel().tolist()},
    ],
)
def test_a_placed_or_mirrored_node_keeps_its_volume(tmp_path, node):
    node = {key: value for key, value in node.items() if value is not None}
    factor = abs(np.prod(node.get("scale", 1)))
    path = write_gltf(tmp_path / "a.gltf", *gltf(box(SIZE), node=node))
    mesh, _, warnings = read(path)
    assert mesh.volume == pytest.approx(factor * np.prod(SIZE), rel=1e-6)
    assert warnings == []


def test_nodes_outside_of_the_scene_do_not_count(tmp_path):
    nodes = [{"mesh": 0}, {"mesh": 0, "translation": [0.2, 0, 0]}]
    path = write_gltf(tmp_path / "a.gltf", *gltf(box(SIZE), nodes=nodes))
    np.testing.assert_allclose(extents(path), [0.04, 0.05, 0.06], atol=1e-7)


def test_a_body_of_several_primitives_is_one(tmp_path):
    """Two materials, each on half of the faces."""
    tree, content = gltf(box(SIZE), materials=[{}, {}])
    half = tree["accessors"][1]["count"] // 2 // 3 * 3
    tree["accessors"][1]["count"] = half
    tree["accessors"].append(dict(tree["accessors"][1], byteOffset=2 * half))
    (first,) = tree["meshes"][0]["primitives"]
    tree["meshes"][0]["primitives"].append({**first, "indices": 2, "material": 1})
    mesh, _, _ = read(write_gltf(tmp_path / "a.gltf", tree, content))
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-6)


FACTOR = {"baseColorFactor": [0.5, 1.0, 0.2, 1.0]}


@pytest.mark.parametrize(
    ("pbr", "color"),
    [
        ({}, (1.0, 1.0, 1.0)),
        (FACTOR, (0.5, 1.0, 0.2)),
        ({"baseColorTexture": {"index": 0}}, (1.0, 0.5, 0.0)),
        (FACTOR | {"baseColorTexture": {"index": 0}}, (0.5, 0.5, 0.0)),
    ],
)
def test_a_colour_is_factor_times_texture(tmp_path, pbr, color):
    cv2.imwrite(str(tmp_path / "my paint.png"), np.full((2, 2, 3), (0, 128, 255), "u1"))
    tree, content = gltf(
        box(SIZE),
        material={"pbrMetallicRoughness": pbr},
        textures=[{"source": 0}],
        images=[{"uri": "my%20paint.png"}],
    )
    _, (seen,), warnings = read(write_gltf(tmp_path / "a.gltf", tree, content))
    assert seen == pytest.approx(color, abs=0.005)
    assert warnings == []


def test_a_gltf_without_materials_is_white(tmp_path):
    _, colors, _ = read(write_gltf(tmp_path / "a.gltf", *gltf(box(SIZE))))
    assert colors == [(1.0, 1.0, 1.0)]


def test_a_missing_texture_is_told(tmp_path):
    tree, content = gltf(box(SIZE), images=[{"uri": "none.png"}])
    _, _, (warning,) = read(write_gltf(tmp_path / "a.gltf", tree, content))
    assert warning == "does not exist, so its colour is lost: none.png"


DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"


def compress_draco(tree):
    """Leave the content to an extension, as files compressed by it do."""
    for accessor in tree["accessors"]:
        del accessor["bufferView"]
    (primitive,) = tree["meshes"][0]["primitives"]
    primitive["extensions"] = {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}


def compress_meshopt(tree):
    tree["buffers"].append({"byteLength": 96, "extensions": {MESHOPT: {}}})
    tree["bufferViews"][0]["buffer"] = 1


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (compress_draco, f"needs the glTF extension {DRACO} .export without compr"),
        (compress_meshopt, f"needs the glTF extension {MESHOPT} .export without compr"),
        (lambda t: t.update(extensionsRequired=["X_new"]), "extension X_new"),
        (lambda t: t["asset"].update(version="1.0"), "is glTF 1.0, must be 2.0"),
        (lambda t: t["nodes"][0].update(skin=0), "has a skin"),
        (lambda t: t["meshes"][0].update(weights=[1]), "has morph targets in use"),
        (
            lambda t: t["meshes"][0]["primitives"][0].update(mode=6),
            "has triangle fans",
        ),
        (lambda t: t["buffers"][0].update(byteLength=10**6), "of 1000000 bytes"),
        (
            lambda t: t["bufferViews"][1].update(byteOffset=0),
            "a triangle names a vertex beyond the last of its 8 vertices",
        ),
        (lambda t: t.pop("accessors"), "cannot be read as glTF: KeyError: 'accessors'"),
    ],
)
def test_what_is_not_read_is_refused_by_name(tmp_path, change, problem):
    tree, content = gltf(box(SIZE))
    path = write_gltf(tmp_path / "a.gltf", tree, content)
    change(tree)
    path.write_text(json.dumps(tree))
    with pytest.raises(ScenarioError, match=rf"a\.gltf: .*{problem}"):
        read(path)


def test_a_missing_buffer_is_named(tmp_path):
    path = write_gltf(tmp_path / "a.gltf", *gltf(box(SIZE)))
    (tmp_path / "part.bin").unlink()
    with pytest.raises(ScenarioError, match=r"its buffer 'part\.bin' does not exist"):
        read(path)


def test_a_source_names_all_files(tmp_path):
    tree, content = gltf(box(SIZE), images=[{"uri": "a.png"}])
    (tmp_path / "a.png").write_bytes(b"not a picture")
    source = read_source(write_gltf(tmp_path / "a.gltf", tree, content))
    assert [path.name for path in source.neighbours] == ["part.bin", "a.png"]
    assert set(source.files.values()) == {content, b"not a picture"}


# What writers of OBJ and STL do.

BOX = box(SIZE)
POINTS = "".join(f"v {x} {y} {z}\n" for x, y, z in BOX[0].tolist())


def faces(form="{}", rows=BOX[1]):
    """Return lines of faces; `form` makes an entry of a vertex's number."""
    entries = (" ".join(form.format(k + 1) for k in row) for row in rows)
    return "".join(f"f {entry}\n" for entry in entries)


OBJS = {
    "negative indices": POINTS + faces("{}", BOX[1] - 9).replace("f --", "f -"),
    "quads": POINTS + faces(rows=QUADS),
    "quads and triangles": POINTS + faces(rows=QUADS[:1]) + faces(rows=BOX[1][2:]),
    "textures": POINTS + "vt 0 0\n" + faces("{}/1"),
    "normals": POINTS + "vn 0 0 1\n" + faces("{}//1"),
    "both": POINTS + "vt 0 0\nvn 0 0 1\n" + faces("{}/1/1"),
    "colours": POINTS.replace("\n", " 1 0 0\n") + faces(),
    "weights": POINTS.replace("\n", " 1.0\n") + faces(),
    "continued lines": POINTS + faces().replace("f 1 ", "f 1 \\\n"),
    "comments": POINTS + faces().replace("\n", "  # a face 0\n"),
    "tabs": (POINTS + faces()).replace(" ", "\t"),
    "indents": (POINTS + faces()).replace("\n", "\n  "),
    "faces first": faces() + POINTS,
    "lines and points": POINTS + faces() + "l 1 2\np 1\n",
    "groups": "o a\n" + POINTS + faces().replace("f 5", "g b\ns off\nf 5", 1),
    "curves": "cstype bezier\ndeg 3\n" + POINTS + faces() + "curv 0 1 1 2 3 4\nend\n",
}
ENDS = ["\n", "\r\n", "\r"]


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("name", OBJS)
def test_an_obj_is_read(tmp_path, name, end):
    path = tmp_path / "a.obj"
    path.write_bytes(OBJS[name].replace("\n", end).encode())
    mesh, _, warnings = read(path)
    assert (mesh.is_volume, warnings) == (True, [])
    assert mesh.volume == pytest.approx(np.prod(SIZE))


def stl(folder, change=str):
    path = write_stl(folder / "valid.stl", BOX)
    return change(path.read_text())


def two_solids(text):
    at = text.index("facet", len(text) // 2)
    at = text.index("facet normal", at)
    return text[:at] + "endsolid thing\nsolid other\n" + text[at:]


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize(
    "change",
    [
        str,
        str.upper,
        two_solids,
        lambda t: t.replace("thing", "für"),
        lambda t: t.replace("thing", "facet normal"),
        lambda t: t.replace("vertex", "\t vertex"),
    ],
)
def test_an_stl_in_text_is_read(tmp_path, change, encoding, end):
    path = tmp_path / "a.stl"
    path.write_bytes(stl(tmp_path, change).replace("\n", end).encode(encoding))
    mesh, _, warnings = read(path)
    assert warnings == []
    assert mesh.volume == pytest.approx(np.prod(SIZE))


def binary(header=b""):
    triangles = b"".join(
        struct.pack("<12fH", 0, 0, 0, *BOX[0][face].ravel(), 0) for face in BOX[1]
    )
    return header.ljust(80, b"\0") + struct.pack("<I", len(BOX[1])) + triangles


@pytest.mark.parametrize("header", [b"", b"solid of a CAD program"])
def test_a_binary_stl_is_read(tmp_path, header):
    path = tmp_path / "a.stl"
    path.write_bytes(binary(header))
    assert read(path)[0].volume == pytest.approx(np.prod(SIZE))


LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.stl", binary()[:-20], "has 664 bytes, but the 12 triangles .* need 684"),
        ("a.stl", binary() + b"more", "has 688 bytes, but the 12 triangles"),
        ("a.stl", b"solid a\nfacet normal 0 0 0\nouter loop\n", "is cut off"),
        ("a.stl", LFS, "git lfs pull"),
        ("a.obj", LFS, "git lfs pull"),
        ("a.glb", LFS, "git lfs pull"),
        ("a.glb", b"PK\3\4", "cannot be read as glTF"),
        ("a.obj", (POINTS + faces("{}", BOX[1] - 1)).encode(), "names vertex 0"),
        ("a.obj", (POINTS + faces("{}", BOX[1] + 9)).encode(), "out of bounds"),
        ("a.obj", (POINTS.replace(".", ",") + faces()).encode(), "cannot be read as a"),
        ("a.obj", b"<!DOCTYPE html>\n<html>404</html>", "another kind of file"),
    ],
)
def test_what_is_no_whole_file_is_refused_by_name(tmp_path, name, content, problem):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match=rf"{name}: .*{problem}"):
        read(path)


def test_trimesh_tells_nothing_by_itself(tmp_path, caplog, capfd):
    path = write_obj(tmp_path / "a.obj", BOX, "mtllib none.mtl")
    read(path)
    assert (caplog.records, *capfd.readouterr()) == ([], "", "")


def test_a_gltf_key_twice_is_refused(tmp_path):
    path = write_gltf(tmp_path / "a.gltf", *gltf(BOX))
    path.write_text(path.read_text().replace('"scene": 0', '"scene": 0, "scene": 1'))
    with pytest.raises(ScenarioError, match=r"a\.gltf: .*key 'scene' twice"):
        read(path)
