import itertools
import json
import sys

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import list_scenarios, load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.benchmark import (
    Benchmark,
    InputRecorder,
    MakeBarePlant,
    Peer,
    benchmark_table,
    import_times,
    measure_robosuite,
    run_benchmark,
    scenarios_with_fast_variant,
)

# A search without an object ends within a second of simulated time.
IN_VAIN = ["object.present=false"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "overrides", "inputs"),
    [
        ("kitchen_impedance", IN_VAIN, ["arm_actuation", "gripper_actuation"]),
        (
            "kitchen",
            [*IN_VAIN, "gripper=!PlantServoDriver {}"],
            ["arm_actuation", "arm_desired_state", "gripper_desired_state"],
        ),
        (
            "clear_table_fast",
            ["clutter.count=2", "planner.time_budget=1.3"],
            ["arm_actuation", "arm_desired_state", "gripper_actuation"],
        ),
    ],
)
def test_the_bare_plant_moves_and_sleeps_as_in_the_run(name, overrides, inputs):
    scenario = load_scenario(name, overrides=overrides)
    log = Simulate(scenario).log
    end = log["time"][-1]
    recorder = InputRecorder(scenario, name)
    recorder.run_task()
    recorder.advance(end)  # later than the planner's end
    recorded = recorder.trajectories()
    assert list(recorded) == inputs
    simulator, advance = MakeBarePlant(scenario, recorded, name)
    advance(end)
    plant = simulator.get_system().GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(simulator.get_context())
    arm = plant.GetModelInstanceByName("arm")
    state = plant.GetPositionsAndVelocities(context, arm)
    np.testing.assert_array_equal(state, log["arm.state_cheat"][-1])
    asleep = []
    for thing in (name for name, config in scenario.objects.items() if config.present):
        model = plant.GetModelInstanceByName(thing)
        body = plant.get_body(plant.GetBodyIndices(model)[0])
        p_WO = body.EvalPoseInWorld(context).translation()
        np.testing.assert_array_equal(p_WO, log[f"object_pose.{thing}"][-1, :3])
        asleep.append(body.is_locked(context))
    assert any(asleep) == (scenario.sleeping is not None)


def test_nothing_of_ours_is_attached_to_the_bare_plant():
    simulator, _ = MakeBarePlant(load_scenario("kitchen_fast"), {}, "kitchen_fast")
    names = [system.get_name() for system in simulator.get_system().GetSystems()]
    assert names == ["plant", "scene_graph"]


def some_benchmark(total=4.0):
    return Benchmark(
        result="success",
        placement_error=[0.001, -0.0005, 0.0],
        simulated=8.0,
        total=total,
        plant=2.0,
        planning=0.5,
        rendering=0.25,
        setup=0.4,
    )


def test_our_systems_take_the_rest_of_the_time():
    benchmark = some_benchmark()
    assert benchmark.other == pytest.approx(1.25)
    rows = benchmark.rows()
    assert rows["speed"] == "2.00 x real time"
    assert rows["bare plant"] == "4.00 x real time"
    assert rows["speed : bare plant"] == "0.50"
    assert rows["placement error x, y"] == "1.00, -0.50 mm"
    assert rows["our systems"] == "1.25 s, 31%"
    assert rows["before and after"] == "0.40 s"


def test_the_table_has_one_column_per_scenario():
    table = benchmark_table(
        {"kitchen": some_benchmark(), "other": some_benchmark(total=8.0)}
    )
    first, *_ = table.splitlines()
    assert first.split() == ["kitchen", "other"]
    (speed,) = [line for line in table.splitlines() if line.startswith("speed  ")]
    assert " ".join(speed.split()) == "speed 2.00 x real time 1.00 x real time"


def test_each_scenario_is_followed_by_its_fast_variant():
    names = scenarios_with_fast_variant()
    assert names[names.index("kitchen") + 1] == "kitchen_fast"
    assert names[names.index("assistive_arm") + 1] == "assistive_arm_fast"
    assert all(name in list_scenarios() for name in names)
    assert len(names) % 2 == 0


@pytest.mark.slow
def test_a_benchmark_measures_every_part(monkeypatch):
    scenario = load_scenario("kitchen", overrides=IN_VAIN)
    looks = Simulate(scenario).status.looks
    clock = itertools.count()  # ticks when it is read: whatever is timed takes 1 s
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock)))
    benchmark = run_benchmark(scenario)
    assert benchmark.result == "not_seen"
    assert benchmark.simulated == pytest.approx(1.0, abs=0.2)
    assert benchmark.plant == 1.0
    assert benchmark.rendering == looks > 0
    assert benchmark.planning == 0.0  # nothing is seen to plan for
    assert benchmark.total >= 1.0
    assert benchmark.setup >= 1.0


@pytest.mark.slow
def test_imports_are_measured_in_processes_of_their_own(monkeypatch):
    clock = itertools.count()
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock)))
    times = import_times()
    assert list(times) == [
        "python without imports",
        "import drake_srg",
        "all imports of a run",
    ]
    assert set(times.values()) == {1.0}


TIMES = {
    "version": "1.5.2",
    "success": True,
    "simulated": 8.25,
    "total": 0.8,
    "lift_steps_per_s": 260.4,
}


def interpreter(path, body):
    """Make an executable that stands in for the other environment's Python."""
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return path


def test_the_last_line_of_the_other_python_holds_its_times(tmp_path):
    text = json.dumps(TIMES)
    python = interpreter(tmp_path / "python", f"echo warnings; echo '{text}'")
    peer = measure_robosuite(python)
    assert peer == Peer(**TIMES)
    assert peer.lines() == [
        "robosuite 1.5.2, IIWA",
        "PickPlaceCan          success, 8.25 s simulated, 0.80 s wall clock",
        "Lift                  260 control steps per s",
    ]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("echo 'no module' >&2; exit 1", "no module"),
        ("exit 3", "exit code 3"),
        ("true", "list index"),
        ("echo '{}'", "missing"),
        ("echo words", "Expecting value"),
    ],
)
def test_an_unfit_python_is_bad_input(tmp_path, body, reason):
    python = interpreter(tmp_path / "python", body)
    with pytest.raises(ScenarioError, match=reason) as caught:
        measure_robosuite(python)
    assert str(caught.value).startswith(f"--peers {python}: must be")


def test_a_missing_python_is_bad_input(tmp_path):
    with pytest.raises(ScenarioError, match="No such file"):
        measure_robosuite(tmp_path / "python")


@pytest.mark.slow
def test_a_python_without_robosuite_is_bad_input():
    with pytest.raises(ScenarioError, match="No module named 'robosuite'"):
        measure_robosuite(sys.executable)
