"""The files of a recorded run, as users open them."""

import av
import numpy as np
import pytest
from chromium import Chromium
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.output import read_log
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.recorders import AddRosbagRecorder, scene_topics
from drake_srg.station import MakeStation
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Mode
from simulation.own_cells import RaisingPort, cell_with

pytestmark = pytest.mark.slow

FILES = {
    "video.mp4",
    "recording.mcap",
    "log.npz",
    "timeline.png",
    "replay.html",
    "replay.glb",
    "metrics.json",
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorded run of less than a second, with small images."""
    out = tmp_path_factory.mktemp("recorded")
    scenario = load_scenario(
        "kitchen",
        overrides=[
            "object.present=false",
            "cameras.overview.width=320",
            "cameras.overview.height=180",
            "recording.bag_depth=true",
            "camera_errors.ceiling.translation=[0.01, 0.0, 0.0]",
        ],
    )
    return Simulate(scenario, name="kitchen", out=out), out


def read_bag(folder):
    """Return the bag's lists of (time [s], message) by topic."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    found = {}
    with Reader(folder / "recording.mcap") as reader:
        for connection, stamp, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((1e-9 * stamp, message))
    return found


@pytest.fixture(scope="module")
def messages(run):
    return read_bag(run[1])


def test_every_artifact_is_where_the_metrics_say(run):
    result, out = run
    assert {path.name for path in out.iterdir()} == FILES
    for path in result.metrics.artifacts.values():
        assert (out / path).stat().st_size > 0


def test_the_video_shows_the_whole_run(run):
    with av.open(str(run[1] / "video.mp4")) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode()]
        assert stream.codec_context.name == "h264"
        assert stream.average_rate == 8
    # The verdict stays for 1.5 s.
    assert len(frames) == pytest.approx(8 * run[0].metrics.sim_time_s + 12, abs=1)
    assert frames[0].shape == (180, 320, 3)
    assert frames[-1].std() > 20.0  # the image is not uniform


def test_the_bag_holds_commands_measurements_and_images(run, messages):
    assert set(messages) >= {
        "/clock",
        "/joint_states",
        "/arm/position_commanded",
        "/gripper/closure_commanded",
        "/gripper/proximity",
        "/gripper/contact_force",
        "/planner/mode",
        "/camera_ceiling/color/image_raw",
        "/camera_ceiling/color/camera_info",
        "/gripper/pwm",
        *("/tf", "/scene"),
    }
    states = messages["/joint_states"]
    assert len(states[0][1].name) == len(states[0][1].position) == 11
    assert states[0][1].name[:2] == ["joint_1", "joint_2"]
    assert [m.data for _, m in messages["/planner/mode"]][-1] == Mode.FAILED.value
    image = messages["/camera_ceiling/color/image_raw"][0][1]
    assert (image.width, image.height, image.encoding) == (640, 480, "rgb8")


def test_the_bag_has_depth_and_where_the_robot_believes_the_camera(messages):
    depths = messages["/camera_ceiling/depth/image_rect_raw"]
    colors = messages["/camera_ceiling/color/image_raw"]
    assert [time for time, _ in depths] == [time for time, _ in colors]
    image = depths[0][1]
    depth = image.data.view("<u2").reshape(image.height, image.width)
    assert np.median(depth) == 1550  # the table [mm]
    position = messages["/camera_ceiling/pose"][0][1].pose.position
    # The image's x is the world's -y.
    found = [position.x, position.y, position.z]
    np.testing.assert_allclose(found, [0.72, -0.01, 1.55], atol=1e-9)


def test_the_bag_has_the_wrench_on_each_link_and_the_grasp(tmp_path):
    overrides = [
        "recording={video_camera: '', bag_cameras: []}",
        "planner=!Script {steps: [{mode: grasp, duration: 1.0, arm: [0, 0, 0.22], "
        "closure: 0}, {mode: close, duration: 1.5, closure: 0.66}]}",
    ]
    scenario = load_scenario("gripper_bench_fast", overrides=overrides)
    Simulate(scenario, name="gripper_bench_fast", out=tmp_path)
    found = {
        topic: [message for _, message in series]
        for topic, series in read_bag(tmp_path).items()
    }
    frames = {t.child_frame_id for t in found["/tf"][0].transforms}
    forces = np.array([message.data for message in found["/gripper/contact_force"]])
    assert np.sum(np.max(forces, axis=0) > 1.0) >= 2  # both fingers hold
    for force, link in zip(forces.T, scenario.gripper.sensor_names, strict=True):
        wrenches = found[f"/gripper/contact_wrench/{link}"]
        assert wrenches[0].header.frame_id == f"gripper/{link}_link"
        assert wrenches[0].header.frame_id in frames
        # The link's y points inward.
        outward = np.array([-message.wrench.force.y for message in wrenches])
        np.testing.assert_array_equal(np.maximum(outward, 0.0), force)
    grasped = [message.data for message in found["/gripper/grasped"]]
    logged = read_log(tmp_path / "log.npz")["gripper.grasped"][1:, 0].tolist()
    # The log has an instant's state after its updates, a bag before them.
    assert grasped.index(True) - logged.index(1.0) in (0, 1)


def test_a_motor_on_wires_has_its_current_and_temperature(tmp_path):
    overrides = [
        "object.present=false",
        "recording={video_camera: '', bag_cameras: []}",
        "gripper.temperature={supply_voltage: 11.5}",
    ]
    scenario = load_scenario("kitchen_tendon", overrides=overrides)
    Simulate(scenario, name="kitchen_tendon", out=tmp_path)
    found = {topic: dict(series) for topic, series in read_bag(tmp_path).items()}
    motor = scenario.gripper.wire_motor
    for stamp, current in found["/gripper/motor_current"].items():
        (pwm,) = found["/gripper/pwm"][stamp].data
        load = motor.drive.full_scale * motor.drive.useful_pwm(pwm)
        stalled = motor.temperature.stall_current * load
        # The spool stands still, or turns slowly.
        assert current.data == pytest.approx(stalled, abs=0.5)
    assert all(20 < m.data < 30 for m in found["/gripper/motor_temperature"].values())


def test_an_object_that_is_never_seen_has_a_topic_without_messages(run, messages):
    assert "/planner/object_pose" not in messages
    with Reader(run[1] / "recording.mcap") as reader:
        assert "/planner/object_pose" in {c.topic for c in reader.connections}


def test_messages_have_simulated_times_above_zero(run, messages):
    for topic, stamped in messages.items():
        times = np.array([time for time, _ in stamped])
        assert times[0] > 0.0, topic
        assert np.all(np.diff(times) > 0.0), topic
        assert times[-1] <= run[0].metrics.sim_time_s + 1e-6, topic
    time, message = messages["/joint_states"][0]
    stamp = message.header.stamp
    assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(time)


def test_bag_and_log_agree(run, messages):
    log = read_log(run[1] / "log.npz")
    for time, message in messages["/joint_states"][::5]:
        row = int(np.argmin(np.abs(log["time"] - time)))
        # Both are sampled at the same time, and the arm is at rest.
        np.testing.assert_allclose(
            message.position[:7], log["arm.state_measured"][row, :7], atol=1e-6
        )


def test_a_browser_plays_the_replay(run, tmp_path):
    page = (run[1] / "replay.html").as_uri()
    plant = MakeModelsPlant(load_scenario("kitchen"))
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName("arm")
    log = run[0].log
    with Chromium(tmp_path) as browser:
        browser.open(f"{page}#t=0")
        for row in (0, len(log["time"]) // 2, -1):
            plant.SetPositions(context, arm, log["arm.state_cheat"][row, :7])
            X_WG = plant.GetFrameByName("palm").CalcPoseInWorld(context)
            browser.evaluate(f"replay.seek({log['time'][row]})")
            shown = browser.evaluate("replay.pose('gripper::palm')")
            np.testing.assert_allclose(shown[:3], X_WG.translation(), atol=1e-5)
            wxyz = X_WG.rotation().ToQuaternion().wxyz()
            assert abs(np.dot(np.roll(wxyz, -1), shown[3:])) == pytest.approx(1)
        assert browser.evaluate("replay.mode") == "failed"
        browser.wait_for("document.querySelector('video').readyState > 1")
        browser.screenshot()
        assert browser.complaints() == []
        assert browser.requests() == [page]


def test_a_run_that_cannot_start_leaves_nothing(tmp_path):
    guess = "simulator_config.integration_scheme=guess"
    scenario = load_scenario("kitchen", overrides=[guess])
    with pytest.raises(ScenarioError):
        Simulate(scenario, out=tmp_path / "on the way" / "out")
    assert not list(tmp_path.iterdir())


def test_a_cell_of_your_own_is_recorded_as_far_as_it_has_ports(tmp_path):
    missing = ("gripper.proximity", "gripper.closure_commanded")
    recording = "recording={video_camera: '', bag_scene: false}"
    scenario = load_scenario("kitchen", overrides=["object.present=false", recording])
    result = Simulate(scenario, out=tmp_path, make_cell=cell_with(leave_out=missing))
    assert not set(missing) & result.log.keys()
    with Reader(tmp_path / "recording.mcap") as reader:
        assert "/joint_states" in reader.topics
        assert not {"/gripper/proximity", "/tf", "/scene"} & set(reader.topics)
    assert (tmp_path / "timeline.png").is_file()


def test_a_scripted_cell_is_recorded_too(tmp_path):
    overrides = ["cameras.overview.width=320", "cameras.overview.height=180"]
    scenario = load_scenario(
        "gripper_bench", overrides=[*overrides, "planner.steps=[{duration: 0.2}]"]
    )
    Simulate(scenario, name="gripper_bench", out=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == FILES
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(tmp_path / "recording.mcap") as reader:
        topics = {c.topic for c in reader.connections}
        assert topics >= {"/joint_states", "/planner/mode"}
        assert "/planner/object_pose" not in topics
        _, _, data = next(
            message
            for message in reader.messages()
            if message[0].topic == "/joint_states"
        )
    message = store.deserialize_cdr(data, "sensor_msgs/msg/JointState")
    assert message.name[:3] == ["gantry_x", "gantry_y", "gantry_z"]


def failing(error, rows=20):
    """Return a `make_cell` whose cell cannot be logged after some rows."""
    period = 0.02
    return cell_with(RaisingPort(error, rows * period))


def test_an_interrupted_run_is_judged_and_recorded_up_to_there(tmp_path):
    scenario = load_scenario("kitchen", overrides=["planner.time_budget=2"])
    result = Simulate(scenario, out=tmp_path, make_cell=failing(KeyboardInterrupt))
    assert not result.metrics.success
    assert result.metrics.failure == "stopped"
    assert result.status.message == "stopped by the user"
    assert {path.name for path in tmp_path.iterdir()} == FILES
    assert len(read_log(tmp_path / "log.npz")["time"]) == 20
    with Reader(tmp_path / "recording.mcap") as reader:
        assert reader.message_count > 0
    with av.open(str(tmp_path / "video.mp4")) as container:
        assert list(container.decode(video=0))


def test_a_failed_run_leaves_its_log_and_recordings_and_nothing_stale(tmp_path):
    for name in FILES:
        (tmp_path / name).write_text("of an earlier run")
    (tmp_path / "notes.txt").write_text("not ours")
    scenario = load_scenario("kitchen", overrides=["object.present=false"])
    with pytest.raises(ZeroDivisionError):
        Simulate(scenario, out=tmp_path, make_cell=failing(ZeroDivisionError))
    kept = {"notes.txt", *FILES} - {"metrics.json"}
    assert {path.name for path in tmp_path.iterdir()} == kept
    assert len(read_log(tmp_path / "log.npz")["time"]) == 20
    assert "data:video/mp4" in (tmp_path / "replay.html").read_text()
    with Reader(tmp_path / "recording.mcap") as reader:
        assert reader.message_count > 0
    with av.open(str(tmp_path / "video.mp4")) as container:
        assert list(container.decode(video=0))


@pytest.mark.parametrize("rows", [0, 1])
def test_a_run_that_fails_at_once_leaves_the_rows_it_has(tmp_path, rows):
    scenario = load_scenario("kitchen", overrides=["recording.video_camera=''"])
    make_cell = failing(ZeroDivisionError, rows)
    with pytest.raises(ZeroDivisionError):
        Simulate(scenario, out=tmp_path, record=False, make_cell=make_cell)
    kept = {"log.npz"} if rows else set()
    assert {path.name for path in tmp_path.iterdir()} == kept


def test_the_first_exception_is_reported(tmp_path, monkeypatch):
    def full(*_):
        raise OSError("full")

    monkeypatch.setattr("drake_srg.recording.recording.write_log", full)
    make_cell = failing(ZeroDivisionError)
    with pytest.raises(ZeroDivisionError):
        Simulate(
            load_scenario("kitchen"),
            out=tmp_path / "out",
            record=False,
            make_cell=make_cell,
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("record", "cameras"),
    [(False, {"ceiling"}), (True, {"ceiling", "side", "fingers"})],
)
def test_unused_cameras_are_not_built(tmp_path, monkeypatch, record, cameras):
    built = []

    def make_cell(scenario, make_planner):
        built.append(set(scenario.cameras))
        raise ScenarioError("enough")

    monkeypatch.setattr("drake_srg.simulation.simulate.MakeCell", make_cell)
    overrides = ["recording={video_camera: side}", "cameras.side={}"]
    scenario = load_scenario("kitchen", overrides=overrides)
    with pytest.raises(ScenarioError, match="enough"):
        Simulate(scenario, out=tmp_path, record=record, make_cell=make_cell)
    assert built == [cameras]


SCENARIO = load_scenario("gripper_bench")


def record(scenario, out):
    """Record 0.1 s of a station, and return its plant and the plant's last state."""
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    topics = scene_topics(station, scenario)
    with AddRosbagRecorder(builder, station, scenario, out, topics):
        simulator = Simulator(builder.Build())
        context = station.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        for name in ("arm.position_commanded", "gripper.closure_commanded"):
            port = station.GetInputPort(name)
            port.FixValue(context, np.zeros(port.size()))
        simulator.AdvanceTo(0.1)
        plant = station.GetSubsystemByName("plant")
        return {
            body.scoped_name().get_full(): plant.EvalBodyPoseInWorld(
                plant.GetMyContextFromRoot(simulator.get_context()), body
            )
            for body in bodies(plant)
        }


def bodies(plant: MultibodyPlant):
    for instance in ("arm", "gripper", "can"):
        if plant.HasModelInstanceNamed(instance):
            for index in plant.GetBodyIndices(plant.GetModelInstanceByName(instance)):
                yield plant.get_body(index)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Poses at the end, and the messages, read by the file's own definitions."""
    out = tmp_path_factory.mktemp("scene")
    poses = record(SCENARIO, out)
    store, found = get_typestore(Stores.EMPTY), {}
    with Reader(out / "recording.mcap") as reader:
        for connection in reader.connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            new = {k: v for k, v in types.items() if k not in store.types}
            store.register(new)
        for connection, _, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return poses, found


def test_transforms_are_the_poses_of_the_moving_bodies(recorded):
    poses, found = recorded
    transforms = found["/tf"][-1].transforms
    names = [each.child_frame_id for each in transforms]
    assert len(set(names)) == len(names)
    assert {"gripper/left_tip_link", "gripper/palm"} <= set(names)
    for each in transforms:
        assert each.header.frame_id == "world"
        p, q = each.transform.translation, each.transform.rotation
        wxyz = np.array([q.w, q.x, q.y, q.z])
        X_WB = RigidTransform(Quaternion(wxyz / np.linalg.norm(wxyz)), [p.x, p.y, p.z])
        expected = poses.get(each.child_frame_id.replace("/", "::"))
        if expected is not None:
            assert X_WB.IsNearlyEqualTo(expected, 1e-6), each.child_frame_id


def test_transforms_come_at_the_rate_of_the_log(recorded):
    _, found = recorded
    assert len(found["/tf"]) == pytest.approx(0.1 / SCENARIO.recording.period, abs=1)
    assert len(found["/tf"]) == len(found["/joint_states"])


def test_the_scene_comes_once_and_every_marker_has_a_frame(recorded):
    _, found = recorded
    (scene,) = found["/scene"]
    frames = {each.child_frame_id for each in found["/tf"][0].transforms}
    assert {marker.header.frame_id for marker in scene.markers} == {"world", *frames}
    keys = [(marker.ns, marker.id) for marker in scene.markers]
    assert len(set(keys)) == len(keys)
    for marker in scene.markers:
        assert marker.type == marker.TRIANGLE_LIST
        assert len(marker.points) % 3 == 0
        assert marker.points
        assert marker.frame_locked
        assert 0.0 < marker.color.a <= 1.0


def test_markers_are_as_large_as_their_bodies(recorded):
    _, found = recorded
    pads = [m for m in found["/scene"][0].markers if m.ns == "gripper/left_tip_link"]
    points = np.array([[p.x, p.y, p.z] for m in pads for p in m.points])
    assert np.ptp(points, axis=0).max() == pytest.approx(0.0588 + 0.007, abs=0.02)


def test_a_station_without_the_state_of_the_scenario_has_no_scene():
    other = load_scenario("assistive_arm")
    assert scene_topics(MakeStation(SCENARIO), other) == []
