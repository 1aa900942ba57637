"""Objects on a table move as their disturbances demand."""

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.cell import AddDisturber
from drake_srg.lifetime import my_context
from drake_srg.planning.script.scripted import ScriptedPlanner, ScriptStep
from drake_srg.simulation.flat import MakeRoot
from drake_srg.station import MakeStation

RADIUS, LENGTH, MASS = 0.0125, 0.05, 0.02  # of the scenario `table`
GRAVITY = 9.81
CENIC = [
    "plant_config.time_step=0",
    "simulator_config.integration_scheme=cenic",
    "simulator_config.max_step_size=0.0078125",
    # CENIC needs periods that are exact in binary, even for systems that do not exist.
    "planner.period=0.015625",
    "recording={period: 0.03125, video_fps: 16, bag_camera_period: 0.5}",
]
BOX = "objects.thing.shape=!Box {size: [0.04, 0.05, 0.06]}"


def poses(scenario, duration):
    """Return the object's poses, every 1/128 s, while the mode is pre_grasp."""

    def add_table(builder, scenario, make_station=MakeStation):
        station = builder.AddNamedSystem("station", make_station(scenario))
        script = [ScriptStep(mode="pre_grasp", duration=duration + 1.0)]
        planner = builder.AddNamedSystem(
            "planner", ScriptedPlanner(np.zeros(0), script)
        )
        AddDisturber(builder, scenario, station, planner)
        builder.ExportOutput(station.GetOutputPort("object_poses_cheat"), "poses")

    def make_table(scenario):
        builder = DiagramBuilder()
        add_table(builder, scenario)
        return builder.Build()

    builder, table = MakeRoot("table", make_table, add_table, scenario, "")
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    port = table.GetOutputPort("poses")
    context = my_context(table, simulator.get_context())
    simulator.Initialize()
    result = [port.Eval(context)["thing"]]
    for time in np.arange(1.0 / 128.0, duration, 1.0 / 128.0):
        simulator.AdvanceTo(time)
        result.append(port.Eval(context)["thing"])
    return result


def tilt(X_WO):
    return np.arccos(np.clip(X_WO.rotation().matrix()[2, 2], -1.0, 1.0))


@pytest.mark.parametrize("overrides", [(), (BOX,), CENIC], ids=["", "box", "cenic"])
@pytest.mark.parametrize("displacement", [(0.0, 0.03, 0.0), (-0.02, -0.01, 0.0)])
def test_a_pushed_object_stands_farther_on_by_the_displacement(
    table, displacement, overrides
):
    push = f"[!Push {{after: 0.1, displacement: {list(displacement)}, duration: 0.4}}]"
    before, *_, after = poses(table(push, *overrides), 1.0)
    moved = after.translation() - before.translation()
    assert moved == pytest.approx(displacement, abs=2e-3)
    assert tilt(after) < np.deg2rad(1.0)


def test_a_push_begins_and_ends_on_time(table):
    push = "[!Push {after: 0.3, displacement: [0.03, 0, 0], duration: 0.3}]"
    x = np.array([X.translation()[0] - 0.5 for X in poses(table(push), 1.2)])
    time = np.arange(len(x)) / 128.0
    assert np.all(np.abs(x[time < 0.3]) < 1e-4)
    # Halfway, up to the stretch of the spring: the path's acceleration, at most
    # 5.77 d / T², over 25² rad²/s².
    (half,) = np.interp([0.45], time, x)
    assert half == pytest.approx(0.015, abs=5.77 * 0.03 / 0.3**2 / 25.0**2)
    assert np.ptp(x[time > 0.9]) < 1e-4


@pytest.mark.parametrize("overrides", [(), CENIC], ids=["", "cenic"])
@pytest.mark.parametrize("direction", [(0.0, 1.0), (-3.0, 1.0)])
def test_a_toppled_cylinder_lies(table, direction, overrides):
    topple = f"[!Topple {{after: 0.1, direction: {list(direction)}}}]"
    X_WO = poses(table(topple, *overrides), 1.5)[-1]
    assert tilt(X_WO) == pytest.approx(np.pi / 2, abs=np.deg2rad(1.0))
    assert X_WO.translation()[2] == pytest.approx(RADIUS, abs=5e-4)
    # It falls in the direction of the push and lands on its side, near its old place.
    axis = X_WO.rotation().matrix()[:2, 2]
    assert axis @ direction / np.linalg.norm(direction) > 0.95
    assert np.linalg.norm(X_WO.translation()[:2] - [0.5, 0.0]) < 2.0 * LENGTH


def test_a_toppled_box_lies_on_its_side(table):
    X_WO = poses(table("[!Topple {direction: [1.0, 0.0]}]", BOX), 1.5)[-1]
    assert tilt(X_WO) == pytest.approx(np.pi / 2, abs=np.deg2rad(1.0))
    assert X_WO.translation()[2] == pytest.approx(0.02, abs=5e-4)


def test_a_lying_object_is_not_toppled(table):
    lying = "objects.thing={position: null, pose: {translation: [0.5, 0, 0.0125], "
    lying += "rotation: !Rpy {deg: [90, 0, 0]}}}"
    first, *_, last = poses(table("[!Topple {}]", lying), 0.5)
    assert np.linalg.norm(last.translation() - first.translation()) < 1e-3


def test_a_force_throws_the_object(table):
    # Upwards with g for 0.1 s, then ballistic: 0.05 m and another 0.05 m.
    force = f"[!Force {{force: [0, 0, {2 * MASS * GRAVITY}], duration: 0.1}}]"
    z = max(X.translation()[2] for X in poses(table(force), 0.5)) - LENGTH / 2
    assert z == pytest.approx(2 * 0.5 * GRAVITY * 0.1**2, rel=0.05)  # steps of 2 ms


def test_the_same_scenario_gives_the_same_bytes(table):
    entries = "[!Topple {direction: [1.0, 1.0]}, !Push {after: 0.6}]"

    def run():
        return b"".join(X.GetAsMatrix4().tobytes() for X in poses(table(entries), 1.0))

    assert run() == run()
