"""The arm's position at the time of an image that arrives late.

Silhouettes in images: their ellipses, and when they are rejected.
The pose of a solid from the points on its visible surface.
"""

import numpy as np
import pytest
from helpers import fix, read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.sensors import CameraConfig, ImageDepth32F, ImageRgba8U

from drake_srg.planning.servoing.tracker import (
    ArmHistory,
    LateSightings,
    PoseSighting,
    SilhouetteTracker,
    ellipse_ends,
    fit_translation,
    silhouette,
)
from drake_srg.types import Box, Cylinder, Sphere
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange
from drake_srg.vision.solids import signed_distance


def moved(stamps, ahead=5.0, history=None):
    """The history of two joints that move evenly; our clock is ahead of the arm's."""
    history = history or ArmHistory()
    for stamp in stamps:
        q = np.array([stamp, -2.0 * stamp])
        history = history.followed_by(stamp, stamp + ahead, q)
    return history


@given(st.floats(0.0, 0.9))
def test_an_even_motion_is_known_at_any_time_of_it(stamp):
    taken = moved([0.0, 0.1, 0.35, 0.9]).at(stamp)
    np.testing.assert_allclose(taken.q, [stamp, -2.0 * stamp], atol=1e-12)
    np.testing.assert_allclose(taken.time, stamp + 5.0)


def test_nothing_is_known_outside_of_the_history():
    history = moved([0.0, 0.5])
    assert history.at(-0.01) is None
    assert history.at(0.51) is None
    assert history.at(np.nan) is None
    assert ArmHistory().at(0.0) is None


def test_what_is_too_long_ago_is_forgotten():
    history = moved(np.linspace(0.0, 3.0, 31))
    assert history.at(1.9) is None
    assert history.at(2.05) is not None
    assert len(history.stamps) <= 12


def test_measurements_that_are_not_new_change_nothing():
    history = moved([0.0, 0.5])
    assert moved([0.5, np.nan], history=history) is history


def test_a_clock_that_is_set_back_begins_anew():
    history = moved([10.0, 10.5, 0.0, 0.5])
    assert history.at(10.2) is None
    np.testing.assert_allclose(history.at(0.25).q, [0.25, -0.5])


PERIOD, AHEAD = 0.0078125, 3.0  # the arm's clock is ahead of ours [s]


class Arm:
    """An arm that turns at 1 rad/s, and what its camera showed."""

    def __init__(self):
        self.system = LateSightings(1, PERIOD)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()

    def run(self, seconds, sighting):
        """Advance; return the newest sighting that can be used."""
        for _ in range(round(seconds / PERIOD)):
            time = self.context.get_time()
            fix(
                self.system,
                self.context,
                arm_state=[time, 1.0],
                arm_stamp=time + AHEAD,
                sighting=AbstractValue.Make(sighting),
            )
            self.simulator.AdvanceTo(time + PERIOD)
        return read(self.system, self.context, "sighting")


def test_a_late_picture_is_dated_and_placed():
    arm = Arm()
    assert arm.run(0.5, PoseSighting()).taken.time == -np.inf
    seen = arm.run(0.1, PoseSighting(7, stamp=0.4 + AHEAD))
    assert seen.frame == 7
    assert seen.taken.time == pytest.approx(0.4)
    np.testing.assert_allclose(seen.taken.q, [0.4], atol=1e-9)


def test_a_picture_from_ahead_of_the_measurements_waits_for_them():
    arm = Arm()
    arm.run(0.25, PoseSighting())
    picture = PoseSighting(7, stamp=0.3 + AHEAD)
    assert arm.run(0.02, picture).taken.time == -np.inf
    assert arm.run(0.06, picture).taken.time == pytest.approx(0.3)


def test_a_picture_from_before_the_history_is_not_used():
    arm = Arm()
    arm.run(1.5, PoseSighting())
    assert arm.run(0.1, PoseSighting(7, stamp=0.3 + AHEAD)).frame == 0
    assert arm.run(0.1, PoseSighting(8, stamp=1.0)).frame == 0  # of another clock


def test_sightings_are_forgotten_once_there_are_none():
    arm = Arm()
    assert arm.run(0.5, PoseSighting(7, stamp=0.1 + AHEAD)).frame == 7
    assert arm.run(PERIOD, PoseSighting()).taken.time == -np.inf


RED = ColorRange.around([0.8, 0.1, 0.08])
CAMERA = CameraModel.from_config(CameraConfig(width=160, height=120))


def disc(u, v, radius, shape=(120, 160)):
    rows, columns = np.indices(shape)
    return (columns - u) ** 2 + (rows - v) ** 2 <= radius**2


def test_the_ends_of_a_disc_are_on_its_rim():
    ends = ellipse_ends(disc(70.0, 50.0, 20.0))
    expected = [[90, 50], [50, 50], [70, 70], [70, 30]]
    np.testing.assert_allclose(ends, expected, atol=0.2)


def test_the_largest_region_counts_unless_the_image_cuts_it():
    both = disc(40, 60, 10) | disc(110, 60, 20)
    np.testing.assert_array_equal(silhouette(both), disc(110, 60, 20))
    assert silhouette(disc(40, 60, 3)) is None
    for u, v in ((5, 60), (155, 60), (80, 5), (80, 115)):
        assert silhouette(disc(u, v, 20)) is None
    assert silhouette(np.zeros((120, 160), bool)) is None


def images(mask, depth):
    color = ImageRgba8U(160, 120)
    color.mutable_data[:] = 255
    color.mutable_data[mask] = (200, 25, 20, 255)
    z = ImageDepth32F(160, 120)
    z.mutable_data[:] = np.inf
    z.mutable_data[mask] = depth
    return {
        "color_image": AbstractValue.Make(color),
        "depth_image": AbstractValue.Make(z),
    }


def see(mask, depth=0.2):
    tracker = SilhouetteTracker(RED, CAMERA)
    context = tracker.CreateDefaultContext()
    fix(tracker, context, **images(mask, depth))
    return read(tracker, context, "sighting")


def test_points_are_those_of_a_pinhole_camera():
    seen = see(disc(79, 59, 20))  # the middle of the image; see DRAKE_PIXEL_CENTER
    focal = CAMERA.color.focal_x()
    expected = np.array([[20, 0], [-20, 0], [0, 20], [0, -20]]) / focal
    np.testing.assert_allclose(seen.points, expected, atol=0.2 / focal)
    np.testing.assert_allclose(seen.depths, 0.2, rtol=1e-6)


def test_equal_images_are_one_frame_and_others_are_not():
    assert see(disc(80, 60, 20)).frame == see(disc(80, 60, 20)).frame
    assert see(disc(80, 60, 20)).frame != see(disc(81, 60, 20)).frame


@pytest.mark.parametrize("depth", [0.0, np.inf])
def test_without_depth_there_are_no_points(depth):
    assert len(see(disc(80, 60, 20), depth).points) == 0


SHAPES = [Cylinder(0.034, 0.1), Box([0.06, 0.05, 0.09]), Sphere(0.035)]


def visible_points(solid, X_CO, rng, count=1500):
    """Points on the surface that faces the camera."""
    size = solid.bounding_size
    p_O = rng.uniform(-0.7, 0.7, (40 * count, 3)) * size
    for _ in range(8):  # onto the surface
        distance, normal = signed_distance(solid, p_O)
        p_O = p_O - distance[:, None] * normal
    _, normal = signed_distance(solid, p_O)
    p_C = p_O @ X_CO.rotation().matrix().T + X_CO.translation()
    facing = np.sum(p_C * (normal @ X_CO.rotation().matrix().T), axis=1) < -1e-3
    return p_C[facing][:count]


@pytest.mark.parametrize("solid", SHAPES, ids=lambda s: type(s).__name__)
@settings(max_examples=5, deadline=None)
@given(st.floats(-0.4, 0.4), st.floats(0.9, 1.4), st.integers(0, 1000))
def test_the_position_is_found_from_above_and_aslant(solid, roll, pitch, seed):
    rng = np.random.default_rng(seed)
    R = RotationMatrix(RollPitchYaw(roll, pitch + np.pi / 2, 0.3))
    X_CO = RigidTransform(R, [*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.15, 0.3)])
    points = visible_points(solid, X_CO, rng)
    noisy = points + 2e-4 * rng.normal(size=points.shape)
    found = fit_translation(noisy, solid, R)
    assert np.linalg.norm(found - X_CO.translation()) < 5e-4


def test_some_points_of_something_behind_do_not_matter():
    rng = np.random.default_rng(1)
    solid = SHAPES[0]
    R = RotationMatrix(RollPitchYaw(0.2, 2.6, 0.0))
    X_CO = RigidTransform(R, [0.01, 0.0, 0.2])
    points = visible_points(solid, X_CO, rng)
    points[::12] *= rng.uniform(1.0, 1.4, (len(points[::12]), 1))
    found = fit_translation(points, solid, R)
    assert np.linalg.norm(found - X_CO.translation()) < 1e-3


def test_a_single_face_does_not_determine_the_position():
    rng = np.random.default_rng(2)
    face = np.column_stack([rng.uniform(-0.02, 0.02, (500, 2)), np.full(500, 0.2)])
    assert fit_translation(face, Box([0.06, 0.06, 0.06]), RotationMatrix()) is None
    assert fit_translation(face[:2], SHAPES[0], RotationMatrix()) is None
