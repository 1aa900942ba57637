import dataclasses as dc
import json

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.output import read_log
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.metrics import OF_INSERTION, OF_SEVERAL, OF_SOME
from drake_srg.simulation.run_log import RunLog
from drake_srg.simulation.simulate import keep_first_replay, take_replay_folder
from drake_srg.types import Mode
from simulation.own_cells import RaisingStep, cell_with

pytestmark = pytest.mark.slow

# Metrics that depend on the machine or the folder.
OF_THE_MACHINE = (
    "planning_wall_s",
    "wall_time_s",
    "real_time_factor",
    "artifacts",
)


def run(*overrides, seed=1, **kwargs):
    scenario = load_scenario("kitchen", seed=seed, overrides=overrides)
    return Simulate(scenario, name="kitchen", record=False, **kwargs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run") / "made" / "on the way"


@pytest.fixture(scope="module")
def golden(folder):
    return run(out=folder)


def test_the_can_is_placed_as_precisely_as_promised(golden):
    metrics = golden.metrics
    assert (metrics.success, metrics.failure, metrics.attempts) == (True, None, 1)
    assert golden.status.mode is Mode.DONE
    assert np.max(np.abs(metrics.localization_error_m)) < 0.5e-3
    assert np.max(np.abs(metrics.placement_error_m[:2])) < 2e-3
    assert metrics.placement_tilt_rad < np.deg2rad(1.0)
    assert 0.0 < metrics.cycle_time_s < 8.0


def test_the_other_metrics_are_plausible(golden):
    metrics = golden.metrics
    assert metrics.seed == 1
    assert metrics.scenario == "kitchen"
    assert 0.0 <= metrics.grasp_shift_m < 5e-3
    assert 0.0 <= metrics.hold_drift_m_per_s < 5e-3
    # At least the can's weight, at most the force of the motors' stall torque.
    assert 3.0 < metrics.peak_contact_force_n < 60.0
    assert metrics.smoothness < 0.0
    assert metrics.sim_time_s > metrics.cycle_time_s
    assert 0.0 < metrics.planning_wall_s < metrics.wall_time_s
    assert metrics.real_time_factor == pytest.approx(
        metrics.sim_time_s / metrics.wall_time_s
    )


def test_the_arrays_of_the_log_have_one_row_per_sample(golden):
    log = golden.log
    (count,) = log["time"].shape
    assert {name: array.shape for name, array in log.items()} == {
        "time": (count,),
        "mode": (count,),
        "arm.state_measured": (count, 14),
        "arm.state_cheat": (count, 14),
        "arm.torque_measured": (count, 7),
        "arm.position_commanded": (count, 7),
        "gripper.state_measured": (count, 8),
        "gripper.closure_commanded": (count, 1),
        "gripper.pwm": (count, 4),
        "gripper.proximity": (count, 4),
        "gripper.grasped": (count, 1),
        "object_pose.soup_can": (count, 7),
        "contact_force": (count,),
    }
    np.testing.assert_allclose(np.diff(log["time"]), 0.02, atol=1e-9)
    for array in log.values():
        assert np.all(np.isfinite(array))


def test_the_modes_come_in_order(golden):
    modes = [list(Mode)[int(i)] for i in golden.log["mode"]]
    order = list(dict.fromkeys(modes))
    assert order == [mode for mode in Mode if mode in order]
    assert order[-1] is Mode.DONE
    assert Mode.LIFT in order


def test_the_can_moves_only_in_the_hand(golden):
    log = golden.log
    p = log["object_pose.soup_can"][:, :3]
    moved = np.linalg.norm(np.diff(p, axis=0), axis=1) > 1e-4
    assert np.any(moved)
    # A released can may still fall by the place height.
    touched = log["contact_force"] > 0.0
    released = log["mode"] == list(Mode).index(Mode.RELEASE)
    assert np.all((touched | released)[1:][moved])


# `make golden` compares whole cycles with those of the last commits.
@pytest.mark.parametrize("name", ["kitchen", "kitchen_fast"])
def test_the_same_seed_gives_the_same_bits(name):
    scenario = load_scenario(name, overrides=["planner.time_budget=1.0"])
    first, second = (Simulate(scenario, warm_up=warm_up) for warm_up in (True, False))
    assert first.log.keys() == second.log.keys()
    for key, array in first.log.items():
        assert array.tobytes() == second.log[key].tobytes(), key
    metrics = [dc.asdict(result.metrics) for result in (first, second)]
    for entry in OF_THE_MACHINE:
        del metrics[0][entry], metrics[1][entry]
    assert metrics[0] == metrics[1]


def test_the_files_contain_the_result(golden, folder):
    assert sorted(path.name for path in folder.iterdir()) == ["log.npz", "metrics.json"]
    metrics = json.loads((folder / "metrics.json").read_text())
    expected = dc.asdict(golden.metrics)
    # Entries that say nothing about this run are left out.
    left_out = (*OF_SEVERAL, *OF_INSERTION, *OF_SOME)
    assert {expected.pop(name) for name in left_out} == {None}
    assert metrics == expected
    log = read_log(folder / "log.npz")
    assert log.keys() == golden.log.keys()
    for name, array in log.items():
        np.testing.assert_array_equal(array, golden.log[name])
    assert golden.metrics.artifacts == {
        "video": None,
        "recording": None,
        "log": str(folder / "log.npz"),
        "timeline": None,
        "replay": None,
        "replay_glb": None,
    }


def test_the_bench_plays_its_script():
    bench = load_scenario("gripper_bench_fast")
    result = Simulate(bench, name="gripper_bench_fast", record=False)
    metrics = result.metrics
    assert (metrics.success, metrics.failure, metrics.attempts) == (True, None, 1)
    assert metrics.cycle_time_s == pytest.approx(
        sum(step.duration for step in bench.planner.steps), abs=0.02
    )
    assert metrics.localization_error_m is None
    assert metrics.hold_drift_m_per_s < 30e-6  # as still as the accurate bench
    assert np.linalg.norm(metrics.placement_error_m) < 2e-3
    z = result.log["object_pose.soup_can"][:, 2]
    assert np.max(z) > z[0] + 0.15  # it was lifted
    assert result.log["arm.state_measured"].shape[1] == 6


def test_a_script_that_drops_its_object_has_misplaced_it():
    bench = load_scenario("gripper_bench_fast", overrides=["object.friction=0"])
    assert bench.planner.steps[2].mode == "lift"
    bench.planner.steps = bench.planner.steps[:3]
    result = Simulate(bench, record=False)
    assert (result.metrics.success, result.metrics.failure) == (False, "misplaced")
    z = result.log["object_pose.soup_can"][:, 2]
    assert z[-1] < z[0] + 0.01  # it was not lifted


def test_a_hidden_object_is_not_seen():
    result = run("object.covered=true")
    assert (result.metrics.success, result.metrics.failure) == (False, "not_seen")
    assert result.metrics.cycle_time_s is None
    assert result.metrics.attempts == 0
    assert result.metrics.sim_time_s < 2.0


@pytest.mark.parametrize(
    ("override", "failure"),
    [
        ("task.place.position=[1.2, -0.7]", "out_of_reach"),
        ("task.place.position=[0.0, 0.0]", "blocked"),  # in the robot's foot
    ],
)
def test_an_impossible_task_fails_with_its_reason(override, failure):
    result = run(override)
    assert (result.metrics.success, result.metrics.failure) == (False, failure)
    assert result.metrics.attempts == 0
    assert result.metrics.sim_time_s < 2.0
    assert result.status.message


# The run with the last budget reaches the planner's time limit on a sample.
@pytest.mark.parametrize(
    ("moves", "budget", "end"),
    [(0, 0.1, 0.625), (3, 0.1, 0.71875), (1000, 0.1, 5.125), (1000, 0.125, 5.15625)],
)
def test_a_run_goes_on_while_what_is_to_be_cleared_moves(
    monkeypatch, moves, budget, end
):
    left = iter([True] * moves)
    moving = property(lambda log: next(left, False))
    monkeypatch.setattr(RunLog, "clearing_moves", moving)
    short = (
        f"planner.time_budget={budget}",
        "recording.period=0.03125",
        "object.present=false",
    )
    scenario = load_scenario("kitchen_fast", overrides=short)
    log = Simulate(scenario, record=False).log
    assert log["time"][-1] == pytest.approx(end)


def test_another_seed_gives_another_run(golden):
    other = run("planner.time_budget=0.05", seed=2)
    first, second = (r.log["object_pose.soup_can"][0, :2] for r in (golden, other))
    assert np.linalg.norm(first - second) > 1e-3


@pytest.mark.parametrize(
    "override",
    [
        "arm.kp=[1.0]",
        "gripper.servo.kp=[1.0]",
        "plant_config.contact_model=sticky",
        "simulator_config.integration_scheme=guess",
        "cameras.ceiling.width=-3",
        "cameras.ceiling.X_PB.base_frame=nowhere",
        "directives=[]",
        "task.place.marker=no.sdf",
        "task.pick=''",
        "gripper=null",
        "arm=null",
        "localizer.cameras=[]",
    ],
)
def test_mistakes_that_only_the_models_show_are_reported_in_one_line(override):
    with pytest.raises(ScenarioError) as error:
        run(override)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) > 20


def test_an_aborted_step_is_reported_with_the_time():
    # What pydrake makes of a failed assertion of Drake's.
    failure = SystemExit("abort: Failure: dt > 0")
    with pytest.raises(ScenarioError) as error:
        run(make_cell=cell_with(RaisingStep(failure, 0.1)))
    assert "kitchen: the simulation failed at t = 0.1" in str(error.value)
    assert "dt > 0" in str(error.value)


def test_infinite_metrics_are_written_as_null(golden, tmp_path):
    metrics = dc.replace(
        golden.metrics, smoothness=np.nan, placement_error_m=[0.0, np.inf, 1.0]
    )
    metrics.write(tmp_path / "metrics.json")
    written = json.loads((tmp_path / "metrics.json").read_text())
    assert written["smoothness"] is None
    assert written["placement_error_m"] == [0.0, None, 1.0]


def test_an_impossible_folder_is_reported_before_the_run(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        run(out=tmp_path / "file" / "run")


def test_only_the_first_run_gets_the_folder(tmp_path):
    assert take_replay_folder() is None
    with keep_first_replay(tmp_path):
        assert take_replay_folder() == tmp_path
        assert take_replay_folder() is None
        with keep_first_replay(None):
            assert take_replay_folder() is None
    assert take_replay_folder() is None


@pytest.mark.slow
def test_a_run_without_recordings_leaves_its_replay_there(tmp_path):
    scenario = load_scenario("kitchen", overrides=["object.present=false"])
    with keep_first_replay(tmp_path):
        kept = Simulate(scenario)
    assert (tmp_path / "replay.html").stat().st_size > 100_000
    assert kept.metrics.artifacts == dict.fromkeys(kept.metrics.artifacts)
    # It changes nothing else.
    again = Simulate(scenario)
    assert kept.log.keys() == again.log.keys()
    assert all((kept.log[name] == again.log[name]).all() for name in kept.log)
