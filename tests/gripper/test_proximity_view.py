"""The fields of view of the grippers' proximity sensors."""

import functools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.sensors import LINKAGE_FINGERS, SRG_FINGERS
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box
from gripper.watching_hand import RADIUS, Hand

RANGE = 0.05  # m
SIXTY = math.radians(60.0)
# The base link's face is 0.4 mm higher at its hinge.
BASE_FACE = (0.026, SRG.face_offset + 0.0004 * (1.0 - 0.026 / 0.0375), 0.0)
PAD = (SRG.pad_middle, SRG.face_offset, 0.0)
# Layout of each gripper, and a point on the inner face of each link with a sensor, in
# the link's frame [m].
GRIPPERS = {
    "srg": (SRG_FINGERS, (BASE_FACE, BASE_FACE, PAD, PAD)),
    "linkage_gripper_flat": (LINKAGE_FINGERS, 2 * [(0.022, 0.0045, 0.0)]),
}
BACK = -0.014  # y behind the thickest link [m]
sensors = st.sampled_from(
    [(g, i) for g, (_, p) in GRIPPERS.items() for i in range(len(p))]
)
distances = st.floats(-0.003, 0.9 * RANGE)
half_angles = st.sampled_from([math.radians(degrees) for degrees in (15, 45, 75, 90)])


@functools.cache
def seeing(gripper, half_angle):
    return Hand(gripper, GRIPPERS[gripper][0], range=RANGE, half_angle=half_angle)


@given(sensor=sensors, distance=distances, half_angle=half_angles)
def test_a_ball_on_the_inner_normal_reads_its_distance(sensor, distance, half_angle):
    gripper, i = sensor
    x, face, z = GRIPPERS[gripper][1][i]
    reading = seeing(gripper, half_angle).beside(i, [x, face + RADIUS + distance, z])
    assert reading == pytest.approx(distance, abs=1e-5)


@given(sensor=sensors, distance=st.floats(-0.003, 0.01), half_angle=half_angles)
def test_a_ball_behind_is_not_seen(sensor, distance, half_angle):
    gripper, i = sensor
    x, _, z = GRIPPERS[gripper][1][i]
    behind = [x, BACK - RADIUS - distance, z]
    assert seeing(gripper, np.pi).beside(i, behind) < RANGE
    assert seeing(gripper, half_angle).beside(i, behind) == RANGE


points = st.tuples(st.floats(0.06, 0.16), st.floats(-0.1, 0.1), st.floats(-0.03, 0.03))


@given(p=points, half_angle=half_angles)
def test_left_and_right_see_the_same(p, half_angle):
    srg = seeing("srg", half_angle)
    left, right = srg.readings(p), srg.readings([p[0], -p[1], p[2]])
    np.testing.assert_allclose(left, right[[1, 0, 3, 2]], atol=1e-5)


@given(p=points, a=half_angles, b=half_angles)
def test_a_wider_view_shows_more(p, a, b):
    narrow, wide = (seeing("srg", angle).readings(p) for angle in sorted((a, b)))
    assert np.all(narrow >= wide)
    assert np.all(wide >= seeing("srg", np.pi).readings(p))


@given(
    degrees=st.floats(0.0, 59.9) | st.floats(60.1, 90.0),
    distance=st.floats(1e-4, 0.04),
    z=st.floats(-0.01, 0.01),
)
def test_a_pad_sees_beyond_its_end_by_the_half_angle(degrees, distance, z):
    away, inwards = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    p_PB = (RADIUS + distance) * np.array([away, inwards, 0.0])  # from the pad's end
    end = np.array([SRG.pad_end, SRG.face_offset, z])
    reading = seeing("srg", SIXTY).beside(2, end + p_PB)
    if degrees < 60.0:
        assert reading == pytest.approx(distance, abs=1e-5)
    else:  # nothing, or what the carrier sees past the pad
        assert reading > distance + 0.002


# A hand that points down at a flat object on a table, its pads upright.

FLAT = ObjectConfig(shape=Box([0.03, 0.06, 0.01]), mass=0.05, friction=0.8)
# Height of the palm with the fingertips on the table at their lowest [m].
LOWEST = SRG.hinge_x + math.hypot(SRG.finger_length, SRG.face_offset)


def rig_over_flat_object(half_angle):
    """Return a rig with its fingertips 6 mm beside the object.

    They come as close as 2.5 mm to the table. Sensors fire at 3 mm.
    """
    driver = f"gripper=!SrgPositionDriver {{proximity: {{half_angle: {half_angle}}}}}"
    home = [0.0, 0.0, LOWEST + 0.0025]
    rig = Rig(bench_scenario(FLAT, home=home, overrides=[driver]))
    rig.advance(1.0, closure=math.radians(82.0) / SRG.full_scale)
    return rig


def test_fingertips_see_a_flat_object_and_not_the_table_below_them():
    rig = rig_over_flat_object(SIXTY)
    trigger = rig.scenario.gripper.proximity.trigger_distance
    assert np.all(rig.measured("gripper.proximity") > trigger)
    assert rig.measured("gripper.grasped") == [0.0]
    rig.advance(1.0, closure=0.6, force_limit=0.5)
    np.testing.assert_array_less(rig.measured("gripper.proximity")[2:], 0.0)
    assert rig.measured("gripper.grasped") == [1.0]
    rig.move([0.0, 0.0, 0.3], 1.0)
    assert rig.X_WO().translation()[2] > 0.1
    np.testing.assert_array_less(rig.measured("gripper.proximity")[2:], 0.0)


def test_fingertips_that_see_all_round_take_the_table_for_an_object():
    rig = rig_over_flat_object(np.pi)
    trigger = rig.scenario.gripper.proximity.trigger_distance
    assert np.all(rig.measured("gripper.proximity")[2:] < trigger)
    assert rig.measured("gripper.grasped") == [1.0]


def test_fingertips_do_not_feel_the_table_that_they_press():
    rig = rig_over_flat_object(SIXTY)
    rig.move([0.0, 0.0, LOWEST - 0.001], 0.5)
    assert sum(rig.contact_forces("table").values()) > 1.0
    assert np.all(rig.measured("gripper.proximity") > 0.0)
