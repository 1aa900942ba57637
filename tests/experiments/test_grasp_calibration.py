import numpy as np
import pytest
import yaml
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import grasp_calibration
from drake_srg.experiments.grasp_calibration import (
    EXPERIMENTS,
    STAGES,
    calibration_cycle,
    file_name,
    make_result,
    mean,
)
from drake_srg.experiments.registry import run_experiment
from drake_srg.parsing import configure_parser
from experiments.made_cycles import cycle

SCENARIOS = {name: preset["scenario"] for name, (_, preset) in EXPERIMENTS.items()}
TIP, SHIFT = np.array([1e-4, -1.2e-3, 0.0]), np.array([-2e-4, 1e-4, 0.0])


def failed(result):
    return {(row.name, row.quantity) for row in result.rows if not row.passed}


def pretended(held=TIP, shift=SHIFT):
    """A gripper that holds objects off the drawn tip and moves them on release."""

    def run_one(scenario, seed, tip, corrected, folder):
        p_GO = np.array([0.095, 0.0, 0.0])
        return cycle(p_GO + tip, p_GO + held, seed=seed, error_G=shift - corrected)

    return run_one


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_frames_are_the_measured_ones(name, monkeypatch):
    monkeypatch.setattr(grasp_calibration, "calibration_cycle", pretended())
    result = run_experiment(name, overrides=["seeds=3"])
    assert not failed(result)
    text = result.files[file_name(SCENARIOS[name])]
    frames = [d["add_frame"] for d in yaml.safe_load(text)["directives"]]
    assert [f["name"] for f in frames] == ["gripper::tip", "gripper::released"]
    for frame, moved in zip(frames, (TIP, SHIFT), strict=True):
        np.testing.assert_allclose(frame["X_PF"]["translation"], moved, atol=1e-6)
    seeds = result.tables["cycles"]["seed"]
    assert list(seeds) == [100, 101, 102, 100, 101, 102, 200, 201, 202]


def test_an_error_that_the_frames_do_not_correct_fails():
    cycles = {stage: [cycle(error_G=np.zeros(3))] * 3 for stage in STAGES}
    assert not failed(make_result(cycles, np.zeros(3), np.zeros(3), ""))
    cycles["both corrected"] = [cycle(error_G=np.array([0.0, 3e-4, 0.0]))] * 3
    result = make_result(cycles, np.zeros(3), np.zeros(3), "")
    assert failed(result) == {
        ("both corrected", "mean offset from the goal when placed, palm's y")
    }


def test_calibration_needs_more_than_half_of_the_cycles():
    value = np.ones(3)
    np.testing.assert_array_equal(mean("held", [value, None, value]), value)
    with pytest.raises(ScenarioError, match="only 1 of 2 cycles held"):
        mean("held", [value, None])


@pytest.mark.slow
def test_a_cycle_uses_the_given_frames(tmp_path):
    moved = np.array([0.0, 1e-3, 0.0])
    result = calibration_cycle("assistive_arm", 0, moved, np.zeros(3), tmp_path)
    assert result.metrics.success
    # The open hand takes its tip to the object, within some tenths of a millimetre.
    np.testing.assert_allclose(result.p_GO_open[:2], [0.095, 1e-3], atol=3e-4)


@pytest.mark.parametrize("scenario", SCENARIOS.values())
def test_the_checked_in_tip_is_within_2_mm_of_the_drawn_one(scenario):
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    configure_parser(parser)
    parser.AddModels(url="package://drake_srg/sdf/linkage_gripper.sdf")
    plant.RenameModelInstance(
        plant.GetModelInstanceByName("linkage_gripper"), "gripper"
    )
    url = f"package://drake_srg/calibration/{file_name(scenario)}"
    path = parser.package_map().ResolveUrl(url)
    ProcessModelDirectives(LoadModelDirectives(path), parser)
    plant.Finalize()
    tip = plant.GetFrameByName("tip").GetFixedPoseInBodyFrame()
    assert np.linalg.norm(tip.translation() - [0.095, 0.0, 0.0]) < 2e-3
