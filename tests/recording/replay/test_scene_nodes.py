import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.recording.replay.glb import write_glb
from drake_srg.recording.replay.scene import (
    METERS_PER_NEWTON,
    force_node,
    pose_row,
    pose_tracks,
)
from recording.replay.strict_reader import Strict

TIME = np.arange(6) / 50
# Contact in the samples 1, 2 and 4.
SAMPLES = [
    (1, np.array([0.1, 0.2, 0.3, 0.0, 0.0, 2.0])),
    (2, np.array([0.1, 0.2, 0.4, 0.0, 3.0, 0.0])),
    (4, np.array([0.5, 0.2, 0.4, 0.0, 0.0, -4.0])),
]


def at(track, time):
    """Return a track's value at one of its sample times, held where it has none."""
    return np.array([np.interp(time, track.time, column) for column in track.values.T])


def test_an_arrow_has_the_forces_place_direction_and_size():
    node = force_node(("table", "can"), SAMPLES, TIME)
    assert node.name == "force of table on can"
    for i, row in SAMPLES:
        scale = at(node.tracks["scale"], TIME[i])
        force = np.linalg.norm(row[3:])
        np.testing.assert_allclose(scale, [1, 1, METERS_PER_NEWTON * force])
        np.testing.assert_allclose(at(node.tracks["translation"], TIME[i]), row[:3])
        x, y, z, w = at(node.tracks["rotation"], TIME[i])
        direction = RigidTransform(Quaternion(w, x, y, z), [0, 0, 0]) @ [0, 0, 1]
        np.testing.assert_allclose(direction, row[3:] / force, atol=1e-12)


def test_without_contact_an_arrow_has_no_size():
    node = force_node(("table", "can"), SAMPLES, TIME)
    for i in (0, 3, 5):
        np.testing.assert_array_equal(at(node.tracks["scale"], TIME[i]), [0, 0, 0])
    Strict(write_glb([node], {}))


def test_a_steady_force_needs_two_samples_at_most():
    samples = [(i, SAMPLES[0][1]) for i in range(len(TIME))]
    node = force_node(("table", "can"), samples, TIME)
    assert all(len(track.time) <= 2 for track in node.tracks.values())


@given(st.tuples(*3 * [st.floats(-3, 3)]))
def test_a_pose_is_kept(angles):
    X = RigidTransform(RollPitchYaw(*angles), [1.0, 2.0, 3.0])
    tracks = pose_tracks(TIME[:1], pose_row(X)[None])
    x, y, z, w = tracks["rotation"].values[0]
    again = RigidTransform(Quaternion(w, x, y, z), tracks["translation"].values[0])
    assert again.IsNearlyEqualTo(X, 1e-12)
    assert np.linalg.norm([x, y, z, w]) == pytest.approx(1)
