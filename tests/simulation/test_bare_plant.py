import numpy as np
import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.bare_plant import InputRecorder, MakeBarePlant

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
