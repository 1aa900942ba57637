import math
import threading

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from rosbags.rosbag2 import Reader

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording import rosbag
from drake_srg.robot.serve import loop
from drake_srg.robot.serve.action_server import ACTION, goal_info
from drake_srg.robot.serve.bridge import Bridge, Outlet
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.loop import Pacer, Serve
from drake_srg.scenario import load_scenario
from experiments.stands.direct_node import make_message
from robot.serve.fake_bridge import FakeBridge


class Wall:
    """A fake clock, and the stop event whose waits advance it."""

    def __init__(self):
        self.time = 100.0
        self.set = False

    def __call__(self):
        return self.time

    def wait(self, timeout):
        self.time += timeout


def run(wall, rate, steps, work, period=0.005):
    """Pace steps that take `work(step)` [s] each."""
    pacer = Pacer(rate, wall, clock=wall)
    for step in range(1, steps + 1):
        wall.time += work(step)
        pacer.wait(step * period)
    return pacer


@pytest.mark.parametrize("rate", [0.1, 1.0, 2.5])
def test_simulated_time_passes_at_the_rate(rate):
    wall = Wall()
    pacer = run(wall, rate, 2000, lambda step: 0.0005)
    assert wall.time - 100.0 == pytest.approx(10.0 / rate)
    assert pacer.factor == pytest.approx(rate, rel=0.01)
    assert pacer.lost == 0.0


def test_an_infinite_rate_never_waits():
    wall = Wall()
    pacer = run(wall, math.inf, 2000, lambda step: 0.0005)
    assert wall.time - 100.0 == pytest.approx(1.0)
    assert pacer.factor == pytest.approx(10.0, rel=0.01)


@pytest.mark.parametrize(
    ("work", "lost", "late", "too_slow"),
    [
        (lambda step: 0.4 if step == 500 else 0.001, 0.0, 0.0, None),  # caught up with
        (lambda step: 3.0 if step == 500 else 0.001, 3.0 - 0.005, 0.0, None),
        (lambda step: 0.011 if step < 500 else 0.001, 5 * 0.504, 0.0, None),  # at first
        (lambda step: 0.011, 23 * 0.504, 12.0 - 23 * 0.504, 5 / 11),
    ],
)
def test_what_cannot_be_caught_up_with_is_given_up(work, lost, late, too_slow):
    wall = Wall()
    pacer = run(wall, 1.0, 2000, work)
    assert pacer.lost == pytest.approx(lost)
    assert wall.time - 100.0 == pytest.approx(10.0 + lost + late)
    assert pacer.factor == pytest.approx(too_slow or 1.0, rel=0.01)
    assert pacer.too_slow == (too_slow and pytest.approx(too_slow, rel=0.01))


def test_a_stop_ends_a_wait():
    stop = threading.Event()
    threading.Timer(0.05, stop.set).start()
    Pacer(1.0, stop).wait(3600.0)  # returns only because of the stop
    assert stop.is_set()


SCENARIO = load_scenario("kitchen")


PICTURES = {
    "/camera/color/image_raw",
    "/camera/depth/image_raw",
    "/camera/color/camera_info",
    "/blobs",
    "/object_pose",
}
STATE = {
    "/clock",
    "/joint_states",
    "/arm/position_commanded",
    "/gripper/closure_commanded",
    "/gripper/proximity",
    "/gripper/contact_force",
    "/gripper/pwm",
    "/gripper/grasped",
}
COMMANDS = ("gripper.closure_commanded", "arm.position_commanded")


def serve(act, until, *, name="kitchen", overrides=(), **options):
    """Serve as fast as possible until a simulated time; `act(bridge)` every step."""
    stop = threading.Event()

    def step(bridge):
        act(bridge)
        if bridge.time >= until - 1e-9:
            stop.set()

    bridge = FakeBridge(
        wanted=options.pop("wanted", lambda name: name not in PICTURES),
        ports=options.pop("ports", COMMANDS),
        act=step,
    )
    scenario = options.pop("scenario", None) or load_scenario(name, overrides=overrides)
    options = {"name": name, "rate": 0.0, "stop": stop, **options}
    return bridge, Serve(scenario, bridge.connect, **options)


def states(name="kitchen"):
    """Return the topics of a scenario's state."""
    links = load_scenario(name).gripper.sensor_names
    return STATE | {f"/gripper/contact_wrench/{link}" for link in links}


def do_nothing(bridge):
    pass


@pytest.fixture(scope="module")
def commanded():
    """A run whose client commands arm and gripper at 0.1 s."""

    def act(bridge):
        if abs(bridge.time - 0.102) < 1e-6:
            bridge.inbox.receive("/grasp", 40)
            bridge.inbox.receive("/kuka", [0.1, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])

    return serve(act, until=1.5)


def series(bridge, port):
    return (
        np.array([time for time, _ in bridge.updates]),
        np.array([values[port] for _, values in bridge.updates]),
    )


def test_topics_are_published_every_control_period(commanded):
    bridge, served = commanded
    assert set(bridge.messages) == states()
    times = [time for time, _ in bridge.messages["/joint_states"]]
    # After the first step of each period, 2 ms.
    np.testing.assert_allclose(times, 0.005 * np.arange(len(times)) + 0.002)
    assert len(times) == pytest.approx(300, abs=1)
    assert served.sim_time == pytest.approx(1.5, abs=0.006)
    assert served.commands == 2
    assert bridge.is_closed


def test_a_command_takes_effect_within_one_control_period(commanded):
    bridge, _ = commanded
    time, closure = series(bridge, "gripper.closure_commanded")
    np.testing.assert_array_equal(closure[:, 0], np.where(time > 0.1045, 0.4, 0.0))
    time, arm = series(bridge, "arm.position_commanded")
    np.testing.assert_allclose(arm[0], SCENARIO.arm.home)
    moved = time[np.flatnonzero(arm[:, 0])[0]]
    assert moved <= 0.102 + 0.005 + 1e-9


def test_the_arm_reaches_its_target_within_its_limits(commanded):
    bridge, _ = commanded
    time, arm = series(bridge, "arm.position_commanded")
    rates = [arm]
    for _ in range(3):
        rates.append(np.diff(rates[-1], axis=0) / 0.005)
    for rate, limit in zip(rates[1:], np.deg2rad([110.0, 40.0, 80.0]), strict=True):
        assert np.abs(rate).max() <= limit * (1 + 1e-6)
    # From rest to rest with jerk j alone, d = 0.1 rad takes 4 (d / 2 j)^(1/3).
    duration = 4.0 * (0.1 / (2.0 * np.deg2rad(80.0))) ** (1 / 3)
    there = arm[time > 0.105 + duration + 0.005]
    np.testing.assert_allclose(there[:, 0], 0.1, atol=1e-9)


def test_the_gripper_moves(commanded):
    bridge, _ = commanded
    _, (_, _, gripper, _) = bridge.messages["/joint_states"][-1]
    # Closure 0.4 of 3 rad, all of it in the base joints.
    np.testing.assert_allclose(gripper[:4], [1.2, 1.2, 0.0, 0.0], atol=0.02)


def test_a_gripper_that_waits_for_messages_gets_them():
    def act(bridge):
        if abs(bridge.time - 0.102) < 1e-6:
            bridge.inbox.receive("/grasp", 40)

    overrides = ["gripper.underactuation.evaluate=per_message"]
    bridge, _ = serve(act, until=0.3, overrides=overrides)
    _, (_, _, gripper, _) = bridge.messages["/joint_states"][-1]
    assert np.all(gripper[:2] > 0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kitchen_tendon", "kitchen_fast", "assistive_arm"])
def test_other_scenarios_are_served_too(name):
    def act(bridge):
        bridge.inbox.receive("/grasp", 20)

    bridge, _ = serve(act, until=0.06, name=name)
    motor = {"/gripper/motor_current", "/gripper/motor_temperature"}
    wound = name == "kitchen_tendon"
    assert set(bridge.messages) == states(name) | (motor if wound else set())
    assert series(bridge, "gripper.closure_commanded")[1][-1] == 0.2


@pytest.mark.parametrize("overrides, count", [(["arm.limits=null"], 3), ([], 0)])
def test_an_arm_that_follows_trajectories_has_an_action_server(overrides, count):
    def act(bridge):
        for topic in bridge.inbox.topics.values():
            if topic.name == ACTION.cancel_goal.request and bridge.time < 0.006:
                info = goal_info(make_message, bytes(16), 0.0)
                request = make_message(topic.type, client=3, number=4, goal_info=info)
                bridge.inbox.receive_message(topic.name, request)

    bridge, _ = serve(act, until=0.02, overrides=overrides)
    requests = [name for name in bridge.inbox.topics if name.startswith("rq/")]
    assert len(requests) == count
    replies = bridge.messages.get(ACTION.cancel_goal.reply, [])
    assert len(replies) == (1 if count else 0)


NO_ARM = [
    *("arm=null", "cameras={}", "recording.video_camera=''"),
    *("localizer.cameras=[]", "recording.bag_cameras=[]"),
]
HAND = "{add_model: {name: gripper, file: 'package://drake_srg/sdf/srg.sdf'}}"


def test_a_station_without_an_arm_publishes_the_gripper_s_joint_states():
    overrides = [*NO_ARM, f"directives=[{HAND}]"]
    bridge, _ = serve(do_nothing, until=0.02, overrides=overrides, ports=COMMANDS[:1])
    _, (state, _) = bridge.messages["/joint_states"][-1]
    assert len(state) == 8
    nothing = ["gripper=null", "directives=[]", "objects={}", "task={}"]
    overrides = [*NO_ARM, *nothing]
    bridge, _ = serve(do_nothing, until=0.02, overrides=overrides, ports=())
    assert set(bridge.messages) == {"/clock"}


@pytest.mark.slow
def test_the_recording_has_every_topic(tmp_path):
    def act(bridge):
        bridge.inbox.receive("/grasp", 30)

    _, served = serve(act, until=0.2, out=tmp_path)
    assert served.recording == tmp_path / "recording.mcap"
    with Reader(served.recording) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts == dict.fromkeys(states(), 10)  # every 0.02 s
    assert served.replay == tmp_path / "replay.html"
    assert {path.name for path in tmp_path.iterdir()} == {
        *("recording.mcap", "log.npz", "timeline.png", "replay.glb", "replay.html")
    }


@pytest.mark.slow
def test_pictures_and_blobs_arrive_from_the_camera_process():
    def stop_when_all_are_there(bridge):
        if set(bridge.messages) >= PICTURES:
            stop.set()

    stop = threading.Event()
    timer = threading.Timer(60.0, stop.set)  # as a guard
    timer.start()
    bridge = FakeBridge(ports=COMMANDS, act=stop_when_all_are_there)
    # Slowly, because the station has nothing to do until the process has started.
    Serve(load_scenario("kitchen"), bridge.connect, rate=0.1, stop=stop)
    timer.cancel()
    _, (color,) = bridge.messages["/camera/color/image_raw"][0]
    _, (depth,) = bridge.messages["/camera/depth/image_raw"][0]
    _, (blobs,) = bridge.messages["/blobs"][0]
    assert color.shape == (480, 640, 3) and color.dtype == np.uint8
    assert depth.shape == (480, 640) and depth.dtype == np.float32
    assert [blob.object_name for blob in blobs] == ["soup_can"]


@pytest.mark.slow
def test_a_failure_of_drake_is_reported_and_keeps_the_recording(tmp_path, monkeypatch):
    advance = Simulator.AdvanceTo

    def give_up(self, time, **options):
        if time > 0.1:
            raise RuntimeError("the solver gave up")
        return advance(self, time, **options)

    monkeypatch.setattr(Simulator, "AdvanceTo", give_up)
    with pytest.raises(ScenarioError, match=r"kitchen: .* at t = 0.100 s: the solver"):
        serve(do_nothing, until=1.0, out=tmp_path)
    with Reader(tmp_path / "recording.mcap") as reader:
        assert reader.duration == pytest.approx(0.08e9, rel=0.1)


def test_ports_that_the_station_lacks_are_named():
    with pytest.raises(ScenarioError, match="kitchen: the station has no grip"):
        serve(do_nothing, until=0.01, ports=["gripper.speed"])


def test_an_unwritable_folder_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError):
        serve(do_nothing, until=0.01, out=tmp_path / "file" / "x")


@pytest.mark.slow
def test_a_rate_out_of_reach_is_reported_once(monkeypatch):
    monkeypatch.setattr(loop, "_WINDOW", 0.05)  # s
    told = []
    serve(do_nothing, until=1.0, rate=1e6, tell=told.append)
    (text,) = told
    assert "cannot keep 1e+06 x real time with kitchen" in text


def test_the_station_ends_with_its_last_bridge():
    class Ending(FakeBridge):
        @property
        def closed(self):
            return self.time > 0.0525

    bridge = Ending(wanted=lambda name: False)
    served = Serve(load_scenario("kitchen"), bridge.connect, rate=0.0)
    assert served.sim_time == pytest.approx(0.06)


def test_a_failed_start_keeps_the_recording_of_the_last_run(tmp_path):
    (tmp_path / "recording.mcap").write_text("of the last run")
    with pytest.raises(ScenarioError):
        serve(do_nothing, until=0.01, ports=["gripper.speed"], out=tmp_path)
    assert (tmp_path / "recording.mcap").read_text() == "of the last run"


CLOCK = rosbag.clock()


class Failing(FakeBridge):
    def publish(self, topic, time, values):
        raise RuntimeError("broken line")

    def update(self, time, values):
        raise RuntimeError("broken line")


@pytest.fixture
def warnings(told):
    return Warnings(told.append)


def test_messages_go_to_the_bridges_with_subscribers(warnings):
    listening = FakeBridge(wanted=lambda name: name == "/clock")
    deaf = FakeBridge(wanted=lambda name: False)
    outlet = Outlet([listening, deaf], warnings)
    assert outlet.has_subscribers("/clock")
    assert not outlet.has_subscribers("/joint_states")
    outlet.send(CLOCK, 1.0, [])
    assert (listening.messages, deaf.messages) == ({"/clock": [(1.0, [])]}, {})


def test_each_bridge_gets_the_values_of_its_ports(warnings):
    one, other = FakeBridge(ports=["a"]), FakeBridge(ports=["a", "b"])
    Outlet([one, other], warnings).update(0.5, {"a": 1, "b": 2, "c": 3})
    assert one.updates == [(0.5, {"a": 1})]
    assert other.updates == [(0.5, {"a": 1, "b": 2})]


def test_a_failing_bridge_is_reported_once_a_task_and_stops_no_other(warnings, told):
    good = FakeBridge()
    outlet = Outlet([Failing(), good], warnings)
    for time in (0.0, 0.1):
        outlet.send(CLOCK, time, [])
        outlet.update(time, {})
    assert len(good.messages["/clock"]) == len(good.updates) == 2
    assert told == [
        "Failing /clock: RuntimeError('broken line')",
        "Failing update: RuntimeError('broken line')",
    ]


def test_the_status_joins_those_of_the_bridges(warnings):
    outlet = Outlet([FakeBridge(), Bridge(), FakeBridge()], warnings)
    assert outlet.status == "fake, fake"
