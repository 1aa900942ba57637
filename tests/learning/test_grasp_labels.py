"""Labelled grasps, and their files."""

import io

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from sweeps.stub import InlineEngine

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning import grasp_labels
from drake_srg.learning.grasp_labels import (
    LabelJob,
    best,
    check_labels,
    draw_labels,
    label_grasps,
    write_labels,
)
from drake_srg.planning.grasps import sampled_grasps

JOB = LabelJob("061_foam_brick", "package://drake_srg/sdf/061_foam_brick.sdf", seed=3)


@pytest.fixture(scope="module", autouse=True)
def _few_per_direction():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampled_grasps, "_PER_DIRECTION", 2)
        yield


def label(job, n):
    with InlineEngine() as engine:
        return label_grasps(job, n, engine, lambda count: None)


@pytest.fixture(scope="module")
def labels():
    return label(JOB, 5)


def pose(grasp):
    w, xyz = grasp["orientation"]["w"], grasp["orientation"]["xyz"]
    quaternion = np.array([w, *xyz])
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-5)
    R = Quaternion(quaternion / np.linalg.norm(quaternion))
    return RigidTransform(R, grasp["position"])


def test_so_many_as_asked_and_fewer_are_the_first_ones(labels):
    assert len(labels) == 5
    assert any(x.success for x in labels)
    for one, other in zip(label(JOB, 1), labels, strict=False):
        assert one.strength == other.strength
        assert one.grasp.X_OG.IsExactlyEqualTo(other.grasp.X_OG)


def test_yaml_is_an_isaac_grasp_file(labels, tmp_path):
    write_labels(tmp_path / "a.yaml", JOB, labels)
    tree = yaml.safe_load((tmp_path / "a.yaml").read_text("utf-8"))
    assert (tree["format"], tree["format_version"]) == ("isaac_grasp", 1.0)
    assert tree["object_frame_link"] == "061_foam_brick"
    assert tree["gripper_frame_link"] == "palm"
    assert list(tree["grasps"]) == [f"grasp_{i}" for i in range(5)]
    for grasp, expected in zip(tree["grasps"].values(), labels, strict=True):
        assert grasp["confidence"] == float(expected.success)
        assert pose(grasp).IsNearlyEqualTo(expected.grasp.X_OG, 1e-5)
        assert grasp["margin"] == pytest.approx(expected.strength - 1.0, abs=1e-4)
        assert grasp["cspace_position"].keys() == expected.closed.keys()


def test_parquet_has_the_same_in_rows(labels, tmp_path):
    write_labels(tmp_path / "a.parquet", JOB, labels)
    content = io.BytesIO((tmp_path / "a.parquet").read_bytes())
    rows = pyarrow.parquet.read_table(content).to_pylist()
    assert [row["success"] for row in rows] == [x.success for x in labels]
    assert rows[0]["closed_left_tip_joint"] == pytest.approx(
        labels[0].closed["left_tip_joint"], abs=1e-5
    )


def test_same_seed_same_bytes(labels, tmp_path):
    for name in ("a.yaml", "b.yaml"):
        write_labels(tmp_path / name, JOB, labels)
    assert (tmp_path / "a.yaml").read_bytes() == (tmp_path / "b.yaml").read_bytes()


def test_the_best_come_first(labels):
    order = [x.strength for x in best(labels)]
    assert order == sorted(order, reverse=True)
    assert len(best(labels, 3)) == 3


def test_checks_are_spread_over_the_labels(labels, monkeypatch):
    monkeypatch.setattr(grasp_labels, "check_label", lambda job, x: x)
    with InlineEngine() as engine:
        pairs = check_labels(JOB, labels, 3, engine, lambda count: None)
    assert [labels.index(a) for a, _ in pairs] == [0, 2, 4]


def test_what_no_hand_takes_is_told(monkeypatch):
    monkeypatch.setattr(grasp_labels, "_HOPELESS", 2)
    job = LabelJob("x", "package://drake_srg/sdf/003_cracker_box.sdf", hand="linkage")
    with pytest.raises(ScenarioError, match=r"at most 52 mm.* 158 x 207 x 66 mm"):
        label(job, 1)


def test_pictures_show_hand_and_object(labels):
    sheet = draw_labels(JOB, labels[:2])
    first = sheet[:200, :200].reshape(-1, 3).astype(int)
    assert 0.05 < np.mean(first.min(axis=1) < 250) < 0.7
    assert sheet.shape[1] == 1000
