import numpy as np
import pytest
import yaml
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.errors import ScenarioError
from drake_srg.experiments import grasp_calibration, grasp_calibration_fast
from drake_srg.experiments.grasp_calibration import (
    SCENARIO,
    SEEDS,
    STAGES,
    calibration_cycle,
    file_name,
    make_result,
    mean,
    run,
)
from drake_srg.experiments.registry import quiet
from drake_srg.parsing import configure_parser
from experiments.made_cycles import cycle

TIP, SHIFT = np.array([1e-4, -1.2e-3, 0.0]), np.array([-2e-4, 1e-4, 0.0])


def failed(result):
    return {(row.name, row.quantity) for row in result.rows if not row.passed}


def pretended(held=TIP, shift=SHIFT):
    """A gripper that holds beside the drawing's tip, and moves what it lets go."""

    def run_one(scenario, seed, tip, corrected, folder):
        p_GO = np.array([0.095, 0.0, 0.0])
        return cycle(p_GO + tip, p_GO + held, seed=seed, error_G=shift - corrected)

    return run_one


def test_the_frames_are_what_was_measured(monkeypatch):
    monkeypatch.setattr(grasp_calibration, "calibration_cycle", pretended())
    result = run(quiet)
    assert not failed(result)
    text = result.files[file_name(SCENARIO)]
    frames = [d["add_frame"] for d in yaml.safe_load(text)["directives"]]
    assert [f["name"] for f in frames] == ["gripper::tip", "gripper::released"]
    for frame, moved in zip(frames, (TIP, SHIFT), strict=True):
        np.testing.assert_allclose(frame["X_PF"]["translation"], moved, atol=1e-6)
    assert len(result.tables["cycles"]["seed"]) == len(STAGES) * len(SEEDS)


def test_what_the_frames_do_not_make_up_for_fails():
    cycles = {stage: [cycle(error_G=np.zeros(3))] * 3 for stage in STAGES}
    assert not failed(make_result(cycles, np.zeros(3), np.zeros(3), ""))
    cycles["both"] = [cycle(error_G=np.array([0.0, 3e-4, 0.0]))] * 3
    result = make_result(cycles, np.zeros(3), np.zeros(3), "")
    assert failed(result) == {("both", "mean placed beside the goal, palm's y")}


def test_too_few_that_were_held_calibrate_nothing():
    there = np.ones(3)
    np.testing.assert_array_equal(mean("held", [there, None, there]), there)
    with pytest.raises(ScenarioError, match="only 1 of 2 cycles held"):
        mean("held", [there, None])


def test_a_cycle_takes_the_frames_that_it_is_given(tmp_path):
    moved = np.array([0.0, 1e-3, 0.0])
    result = calibration_cycle(SCENARIO, 0, moved, np.zeros(3), tmp_path)
    assert result.metrics.success
    # The open hand takes its tip to the object; servos leave some tenths.
    np.testing.assert_allclose(result.p_GO_open[:2], [0.095, 1e-3], atol=3e-4)


@pytest.mark.parametrize("scenario", [SCENARIO, grasp_calibration_fast.SCENARIO])
def test_the_frames_in_use_can_be_read(scenario):
    """What is checked in has the tip within two millimetres of the drawing."""
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
