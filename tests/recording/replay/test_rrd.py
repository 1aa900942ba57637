import sys

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Sphere
from pydrake.math import RotationMatrix

from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.replay.glb import (
    EXTRAS,
    Node,
    Part,
    Track,
    read_glb,
    write_glb,
)
from drake_srg.recording.replay.rrd import at_times, track_times, write_rrd
from drake_srg.recording.replay.triangles import shape_triangles
from recording.replay.tiny_scene import PERIOD, SAMPLES, record

WHY = "rerun-sdk is an extra of 500 MB that requirements.lock leaves out"


def test_values_hold_until_the_next_sample():
    track = Track(np.array([0.0, 0.1, 0.3]), np.array([[1.0], [2.0], [3.0]]))
    values = at_times(track, np.array([0.0, 0.1, 0.2, 0.3, 9.0]))
    np.testing.assert_array_equal(values[:, 0], [1, 2, 2, 3, 3])
    late = Track(np.array([0.2]), np.array([[5.0]]))
    np.testing.assert_array_equal(at_times(late, np.array([0.0, 0.3])), [[5.0]] * 2)


def test_a_node_changes_when_any_of_its_properties_does():
    tracks = {
        "translation": Track(np.array([0.0, 0.2]), np.zeros((2, 3))),
        "scale": Track(np.array([0.1, 0.2]), np.zeros((2, 3))),
    }
    assert track_times(Node("thing", tracks=tracks)).tolist() == [0.0, 0.1, 0.2]
    assert track_times(Node("still")).size == 0


def test_without_the_extra_one_line_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    record(tmp_path)
    assert main(["replay", str(tmp_path), "--rrd"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "170 MB" in line and "[rerun]" in line
    assert not list(tmp_path.glob("*.rrd")) and not list(tmp_path.glob("*.html"))


def test_several_folders_are_refused(tmp_path, capsys):
    assert main(["replay", str(tmp_path), str(tmp_path), "--rrd"]) == 2
    assert "--rrd: needs one folder" in capsys.readouterr().err


def read(path):
    """Return the columns of a file's entities by path."""
    from rerun.chunk import RrdReader

    found = {}
    for chunk in RrdReader(path).stream():
        table = chunk.to_record_batch()
        columns = dict(zip(table.schema.names, table.columns, strict=True))
        found.setdefault(str(chunk.entity_path), {}).update(columns)
    return found


@pytest.fixture(scope="module")
def chunks(tmp_path_factory):
    """The poses of the simulation, and the columns of the file."""
    pytest.importorskip("rerun", reason=WHY)
    folder = tmp_path_factory.mktemp("recorded")
    poses = record(folder)
    path = write_rrd(folder)
    assert path == folder / "replay.rrd"
    return poses, read(path)


def values(column):
    return np.array(column.to_pylist()).reshape(len(column), -1)


def test_the_file_has_every_pose(chunks):
    poses, found = chunks
    for name, expected in poses.items():
        columns = found["/scene/" + name.replace(":", r"\:")]
        times = columns["time"].cast("int64").to_numpy() * 1e-9
        asked = PERIOD * np.arange(SAMPLES) + 1e-6  # the file's are float32
        positions, turns = (
            at_times(Track(times, values(columns[f"Transform3D:{name}"])), asked)
            for name in ("translation", "quaternion")
        )
        for X, p, (x, y, z, w) in zip(expected, positions, turns, strict=True):
            np.testing.assert_allclose(p, X.translation(), atol=1e-5)
            R = RotationMatrix(Quaternion(np.array([w, x, y, z]))).matrix()
            np.testing.assert_allclose(R, X.rotation().matrix(), atol=1e-5)


def test_the_file_has_meshes_plots_modes_and_cameras(chunks):
    found = chunks[1]
    points = values(found[r"/scene/box\:\:body/0"]["Mesh3D:vertex_positions"])
    np.testing.assert_allclose(np.abs(points), 0.1, atol=1e-6)
    assert "Pinhole:image_from_camera" in found["/scene/side"]
    force = values(found[r"/plots/grip\ force\ \[N\]"]["Scalars:scalars"])
    np.testing.assert_allclose(force[:, 0], np.linspace(0.0, 9.81, SAMPLES))
    words = found["/planner"]["TextLog:text"].to_pylist()
    assert words[-1] == ["close"]


def test_a_soft_body_changes_its_shape(tmp_path):
    pytest.importorskip("rerun", reason=WHY)
    record(tmp_path)
    glb = tmp_path / "replay.glb"
    extras = read_glb(glb.read_bytes())[0]["scenes"][0]["extras"][EXTRAS]
    ball = shape_triangles(Sphere(0.5))
    weights = Track(np.array([0.0, 0.5]), np.array([[0.0], [1.0]]))
    soft = Node("soft", [Part(ball, (1, 1, 1, 1), [ball.points])], {"weights": weights})
    glb.write_bytes(write_glb([soft], {**extras, "sights": []}))
    columns = read(write_rrd(tmp_path))["/scene/soft/0"]
    shapes = [np.array(s) for s in columns["Mesh3D:vertex_positions"].to_pylist()]
    for shape, size in zip(shapes[-2:], (1.0, 2.0), strict=True):
        np.testing.assert_allclose(shape, size * ball.points, atol=1e-6)


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        ("replay.glb", b"glTF", r"replay\.glb: not the scene"),
        ("video.mp4", b"no video", r"video\.mp4: not a video: "),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, file, content, problem):
    pytest.importorskip("rerun", reason=WHY)
    record(tmp_path)
    (tmp_path / file).write_bytes(content)
    with pytest.raises(ScenarioError, match=problem):
        write_rrd(tmp_path)
    assert not list(tmp_path.glob("*.rrd"))
