import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import needs_module
from hypothesis import given, settings
from hypothesis import strategies as st
from robot.serve.waiting import wait_until
from scipy.spatial import ConvexHull

from drake_srg.objects.meshes import pieces
from drake_srg.objects.meshes.pieces import (
    MOST_CORNERS,
    TOLERANCE,
    convex_pieces,
    decimated,
    measure_fit,
)
from objects.meshes.made_meshes import NEEDS_TRIMESH, box, cup, elbow, joined

pytestmark = NEEDS_TRIMESH


def mesh(parts):
    import trimesh

    return trimesh.Trimesh(*parts, process=False)


def depth_outside(points, corners):
    planes = ConvexHull(corners).equations
    return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)


@given(
    st.lists(st.floats(0.01, 0.2), min_size=3, max_size=3),
    st.integers(0, 2**32 - 1),
)
def test_a_box_keeps_its_eight_corners(size, seed):
    """However many points lie on its faces."""
    rng = np.random.default_rng(seed)
    corners, _ = box(size)
    faces = rng.uniform(-0.5, 0.5, (50, 3)) * size
    rows, axis = np.arange(50), rng.integers(0, 3, 50)
    faces[rows, axis] = 0.5 * np.sign(faces[rows, axis]) * np.asarray(size)[axis]
    kept = decimated(np.vstack([corners, faces]))
    assert depth_outside(corners, kept).max() < 1e-4
    assert len(kept) <= 12


@given(st.floats(0.01, 0.1), st.integers(0, 2**32 - 1))
def test_round_hulls_have_few_corners_and_balance_their_error(radius, seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(400, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    kept = decimated(points)
    assert len(kept) <= MOST_CORNERS
    excess = np.linalg.norm(kept, axis=1).max() - radius
    gap = depth_outside(points, kept).max()
    # Without growth, the hull of so few would leave out a fifth of the radius.
    assert max(excess, gap) < max(0.15 * radius, TOLERANCE + 1e-9)


def test_parts_that_are_convex_are_kept():
    both = mesh(joined(box([0.04, 0.05, 0.06]), box([0.02] * 3, at=[0.1, 0.0, 0.0])))
    found, cut = convex_pieces(both, 8, [])
    assert not cut
    assert sorted(len(corners) for corners in found) == [8, 8]


def test_a_hollow_is_not_touched():
    inner, faces = box([0.02] * 3)
    hollow = mesh(joined(box([0.04] * 3), (inner, faces[:, ::-1])))
    found, cut = convex_pieces(hollow, 8, [])
    assert (len(found), cut) == (1, False)


# A label on a body.
FLAT = (np.array([[0, 0, 0.2], [0.01, 0, 0.2], [0, 0.01, 0.2]]), [(0, 1, 2)])
ROW = joined(*[box([0.01] * 3, [0.02 * i, 0, 0]) for i in range(5)])


@pytest.mark.parametrize(
    ("parts", "told"), [(elbow(), []), (ROW, ["CoACD cuts 5 convex parts into 4"])]
)
def test_other_meshes_are_cut_by_coacd(monkeypatch, parts, told):
    calls, warnings = [], []
    monkeypatch.setattr(
        pieces, "_cut", lambda mesh, most: calls.append(most) or [box([0.03] * 3)[0]]
    )
    found, cut = convex_pieces(mesh(parts), 4, warnings)
    assert (len(found), cut, calls) == (1, True, [4])
    assert [text[: len(told[0])] for text in warnings] == told if told else not warnings


def test_only_parts_that_are_not_convex_are_cut(monkeypatch):
    ball, sheet = box([0.02] * 3, [0.2, 0, 0]), FLAT
    calls, warnings = [], []
    monkeypatch.setattr(
        pieces, "_cut", lambda mesh, most: calls.append((mesh, most)) or [ball[0]]
    )
    found, cut = convex_pieces(mesh(joined(ball, elbow(), sheet)), 4, warnings)
    assert (len(found), cut) == (2, True)
    ((given_mesh, most),) = calls
    assert most == 3
    assert given_mesh.volume == pytest.approx(mesh(elbow()).volume)
    assert warnings == ["flat parts are seen, not touched: 1"]


def test_a_cup_of_two_materials_is_cut_as_one_of_one():
    needs_module("coacd")
    vertices, faces, _ = cup()
    found, cut = convex_pieces(mesh((vertices, faces)), 32, [])
    assert cut
    volume = sum(ConvexHull(corners).volume for corners in found)
    assert volume == pytest.approx(mesh((vertices, faces)).volume, rel=0.1)


def test_coacd_cuts_an_elbow_in_two():
    needs_module("coacd")
    solid = mesh(elbow())
    found, cut = convex_pieces(solid, 8, [])
    assert cut
    assert len(found) == 2
    volume = sum(ConvexHull(corners).volume for corners in found)
    assert volume == pytest.approx(solid.volume, rel=0.02)
    fit = measure_fit(solid, found)
    assert max(fit.excess, fit.gap) < TOLERANCE


def test_the_hull_of_an_elbow_does_not_fit():
    solid = mesh(elbow(side=0.03, length=0.09))
    fit = measure_fit(solid, [np.asarray(solid.vertices)])
    # Of all points of the hull's slanted face, the middle is 30 mm from either wall.
    assert fit.excess == pytest.approx(0.03, abs=1e-3)
    assert fit.gap == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=8)  # a measurement takes 0.1 s
@given(st.floats(-0.004, 0.004))
def test_fit_is_the_distance_of_parallel_faces(grow):
    solid = mesh(box([0.05, 0.05, 0.05]))
    fit = measure_fit(solid, [box([0.05, 0.05, 0.05 + 2 * grow])[0]])
    assert fit.excess == pytest.approx(max(grow, 0.0), abs=1e-6)
    assert fit.gap == pytest.approx(max(-grow, 0.0), abs=1e-6)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such call")
def test_cutting_ends_with_the_process_that_asked_for_it(tmp_path):
    told = tmp_path / "child"
    told.touch()
    waits = f"import os, time; open({str(told)!r}, 'w').write(str(os.getpid()))"
    code = (
        "from drake_srg.objects.meshes import pieces\n"
        "import trimesh\n"
        f"pieces._COACD = {waits + '; time.sleep(600)'!r}\n"
        "pieces._cut(trimesh.creation.box(), 4)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    child = Path("/proc", wait_until(told.read_text))
    parent.kill()
    parent.wait()
    assert wait_until(lambda: not child.exists() or "Z" in state(child))


def state(process):
    try:
        return (process / "stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"
