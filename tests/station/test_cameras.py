import numpy as np
import pytest
from helpers import break_camera, fix, port_table
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import bench_scenario
from drake_srg.station import MakeStation
from drake_srg.station.cameras import MakeRemoteCameras
from drake_srg.types import Box

SMALL = ["cameras.ceiling.width=64", "cameras.ceiling.height=48"]
PORTS = ("color_image", "depth_image", "body_pose_in_world")


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("kitchen", overrides=SMALL)


@pytest.fixture(scope="module")
def station(scenario):
    return MakeStation(scenario)


def move_can(station, root, x):
    """Move the can along world's x, in the plant's context."""
    plant = station.GetSubsystemByName("plant")
    context = plant.GetMyMutableContextFromRoot(root)
    (body,) = plant.GetBodyIndices(plant.GetModelInstanceByName("soup_can"))
    X_WO = plant.EvalBodyPoseInWorld(context, plant.get_body(body))
    X_WO.set_translation(X_WO.translation() + np.array([x, 0.0, 0.0]))
    plant.SetFreeBodyPose(context, plant.get_body(body), X_WO)
    return plant.GetPositionsAndVelocities(context)


def image(diagram, context, name="color_image"):
    return diagram.GetOutputPort(f"camera_ceiling.{name}").Eval(context).data.copy()


def test_an_image_shows_the_plant_at_the_time_of_reading(station):
    context = station.CreateDefaultContext()
    before = image(station, context)
    move_can(station, context, 0.05)
    moved = image(station, context)
    assert np.any(moved != before)
    move_can(station, context, -0.05)
    np.testing.assert_array_equal(image(station, context), before)


def test_a_step_renders_nothing(station, scenario):
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    commands = {
        "arm.position_commanded": scenario.arm.home,
        "gripper.closure_commanded": 0.1,
    }
    fix(station, context, **commands)
    for name in ("ceiling", "overview"):
        sensor = station.GetSubsystemByName(f"rgbd_sensor_{name}")
        break_camera(sensor, sensor.GetMyMutableContextFromRoot(context))
    for name in ("color_image", "depth_image"):
        with pytest.raises(RuntimeError, match="broken"):
            image(station, context, name)
    simulator.AdvanceTo(0.1)


def test_no_renderer_follows_the_steps(station):
    # A scene graph passes each change of its poses on to its renderers.
    assert station.GetSubsystemByName("scene_graph").RendererCount() == 0
    assert station.GetSubsystemByName("render_scene_graph").RendererCount() > 0


@pytest.mark.slow
def test_soft_objects_are_rendered_from_the_plants_scene_graph():
    sponge = ObjectConfig(
        shape=Box([0.04, 0.06, 0.05]),
        soft=SoftConfig(),
        mass=0.02,
        friction=0.6,
        resolution=0.03,
        color=[0.9, 0.1, 0.9],
    )
    small = ["cameras.overview.width=160", "cameras.overview.height=128"]
    overrides = ["plant_config.time_step=0.005", *small]
    station = MakeStation(bench_scenario(sponge, overrides=overrides))
    assert not station.HasSubsystemNamed("render_scene_graph")
    port = station.GetOutputPort("camera_overview.color_image")
    pixels = port.Eval(station.CreateDefaultContext()).data[..., :3].astype(float)
    magenta = pixels[..., [0, 2]].min(axis=-1) > 3.0 * pixels[..., 1]
    assert np.count_nonzero(magenta) > 10


@pytest.mark.slow
def test_only_imperfect_cameras_get_imperfections():
    blurred = load_scenario("kitchen", overrides=["camera_errors.ceiling.blur=1.0"])
    station = MakeStation(blurred)
    assert station.HasSubsystemNamed("camera_errors_ceiling")
    assert not station.HasSubsystemNamed("camera_errors_overview")


@pytest.mark.slow
def test_remote_cameras_show_what_the_stations_cameras_do(scenario, station):
    remote = MakeRemoteCameras(scenario)
    names = ("ceiling", "fingers", "overview")
    cameras = [f"camera_{n}.{p}" for n in names for p in PORTS]
    context, root = remote.CreateDefaultContext(), station.CreateDefaultContext()
    state = move_can(station, root, 0.1)
    assert port_table(remote) == ({"state": len(state)}, dict.fromkeys(cameras))
    fix(remote, context, state=state)
    for name in ("color_image", "depth_image"):
        np.testing.assert_array_equal(
            image(remote, context, name), image(station, root, name)
        )


CALIBRATION = "camera_calibrations={ceiling: {X_PB: {base_frame: %s, translation: %s}}}"


def test_a_calibrated_camera_is_believed_where_its_calibration_has_it():
    """Errors of the pose do not count then."""
    errors = "camera_errors.ceiling.translation=[1.0, 0.0, 0.0]"
    calibration = CALIBRATION % ("world", "[0.1, 0.2, 1.3]")
    overrides = [*SMALL, errors, calibration]
    station = MakeStation(load_scenario("kitchen", overrides=overrides))
    context = station.CreateDefaultContext()
    port = station.GetOutputPort("camera_ceiling.body_pose_in_world")
    found = port.Eval(context).translation()
    np.testing.assert_allclose(found, [0.1, 0.2, 1.3], atol=1e-9)


def test_a_calibration_in_another_frame_is_refused():
    calibration = CALIBRATION % ("gripper::palm", "[0.1, 0.2, 1.3]")
    scenario = load_scenario("kitchen", overrides=[*SMALL, calibration])
    message = "base_frame: must be that of cameras.ceiling, world, got gripper::palm"
    with pytest.raises(ScenarioError, match=f"ceiling.X_PB.{message}"):
        MakeStation(scenario)
