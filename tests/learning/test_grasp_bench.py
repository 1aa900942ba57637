"""The bench that labels grasps."""

import dataclasses as dc
import re

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.learning.grasp_bench import HANDS, GraspBench
from drake_srg.parsing import resolve_url
from drake_srg.planning.grasps.sampled_grasps import SampledGrasp

BRICK = "package://drake_srg/sdf/061_foam_brick.sdf"  # 77.8 x 53.3 x 52.5 mm
# The pads' middle is on the middle of the brick, and they close along its y.
PINCH = SampledGrasp(
    X_OG=RigidTransform([-0.15, 0.0, 0.02625]),
    half_gap=0.05,
    width=0.0533,
    score=5.0,
    shifted=False,
    wrapped=False,
)


def moved(p, R=None):
    """The pinch with the hand elsewhere in its own frame."""
    X = RigidTransform(R or RotationMatrix(), p)
    return dc.replace(PINCH, X_OG=PINCH.X_OG @ X)


@pytest.fixture(scope="module")
def bench():
    return GraspBench(BRICK, 1.0, "srg")


@pytest.fixture(scope="module")
def good(bench):
    return bench.label(PINCH)


def test_a_pinch_of_the_middle_survives(good):
    assert good.success
    assert good.strength == 1.6
    assert good.force_closure
    assert good.epsilon > 0.02
    assert good.closed["left_base_joint"] > good.opened["left_base_joint"]


def test_fingers_that_close_beside_the_object_hold_nothing(bench):
    label = bench.label(moved([0.0, 0.0, 0.07]))
    assert (label.strength, label.margin, label.epsilon) == (0.0, -1.0, 0.0)
    assert not label.success
    assert not label.force_closure


def test_the_heavier_an_object_the_earlier_it_is_lost(tmp_path):
    brick = resolve_url(BRICK).read_text("utf-8")
    strengths = []
    for mass in (0.2, 2.0, 10.0):
        path = tmp_path / f"{mass}.sdf"
        path.write_text(re.sub("<mass>.*</mass>", f"<mass>{mass}</mass>", brick))
        strengths.append(GraspBench(str(path), 1.0, "srg").label(PINCH).strength)
    assert strengths[0] == 1.6
    assert 0.0 < strengths[1] < 1.6
    assert strengths[2] == 0.0  # it does not even bear the weight


def test_a_hand_in_the_object_has_no_label(bench):
    assert bench.label(moved([0.1, 0.0, 0.0])) is None


def test_either_finger_may_be_on_either_side(bench, good):
    label = bench.label(moved(np.zeros(3), RotationMatrix.MakeXRotation(np.pi)))
    assert label.success == good.success
    assert label.epsilon == pytest.approx(good.epsilon, rel=0.1)


def test_a_label_does_not_depend_on_those_before(bench, good):
    bench.label(moved([0.0, 0.004, 0.01]))
    again = bench.label(PINCH)
    assert dc.replace(again, grasp=good.grasp) is not good
    for field in ("strength", "epsilon", "closed"):
        assert getattr(again, field) == getattr(good, field)


def test_the_object_floats_until_the_fingers_touch_it(bench):
    bench.label(moved([0.0, 0.0, 0.07]))  # it is not touched, and floats on
    start = bench._X_WG @ moved([0.0, 0.0, 0.07]).X_OG.inverse()
    fallen = np.linalg.norm(bench.X_WO().translation() - start.translation())
    assert fallen < 1e-6


def test_the_linkage_gripper_has_a_bench():
    assert HANDS["linkage"].fingers.max_width < 0.0533
    bench = GraspBench("package://drake_srg/sdf/040_large_marker.sdf", 1.0, "linkage")
    # The marker lies along its x; the pads close along y, 95 mm before the palm.
    grasp = dc.replace(
        PINCH,
        X_OG=RigidTransform(
            RotationMatrix(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])),
            [0.0, 0.0, 0.095 + 0.009],
        ),
        half_gap=0.03,
        width=0.018,
    )
    assert bench.label(grasp).strength > 0.0
