"""Recordings of any diagram."""

import contextlib
import enum
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box, HalfSpace
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from rosbags.highlevel import AnyReader

from drake_srg.lifetime import LeafSystem
from drake_srg.recording.output import read_log
from drake_srg.recording.recording import FILES, AddRecording
from drake_srg.recording.replay.glb import read_glb
from drake_srg.recording.replay.page import read_run
from recording.replay.tiny_scene import add_camera


class Stage(enum.Enum):
    FALLS = enum.auto()
    LIES = enum.auto()


class Watch(LeafSystem):
    """Outputs with ports of all kinds whether the box falls."""

    def __init__(self, plant):
        super().__init__()
        self.plant = plant
        self.state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        for name, model, value in (
            ("stage", Stage.FALLS, lambda v: Stage.FALLS if v < -0.01 else Stage.LIES),
            ("word", "up", lambda v: "down" if v < -0.01 else "up"),
            ("number", 0.0, float),
            ("pose", RigidTransform(), lambda v: RigidTransform([0.0, 0.0, v])),
            ("other", [], lambda v: []),
        ):
            self.DeclareAbstractOutputPort(
                name,
                alloc=lambda model=model: AbstractValue.Make(model),
                calc=lambda context, output, value=value: output.set_value(
                    value(self.speed(context))
                ),
                prerequisites_of_calc={self.state.ticket()},
            )
        self.DeclareVectorOutputPort(
            "speed",
            1,
            lambda context, output: output.SetFromVector([self.speed(context)]),
            {self.state.ticket()},
        )

    def speed(self, context):
        """Return the box's vertical speed [m/s]."""
        return self.state.Eval(context)[-1]


def falling_box(watched=True):
    """Return a builder with a box above the ground, its plant, scene and watch."""
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, 0.002)
    box = plant.AddModelInstance("box")
    inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
    body = plant.AddRigidBody("body", box, inertia)
    friction = CoulombFriction(0.5, 0.5)
    plant.RegisterCollisionGeometry(
        body, RigidTransform(), Box(0.1, 0.1, 0.1), "box", friction
    )
    plant.RegisterVisualGeometry(
        body, RigidTransform(), Box(0.1, 0.1, 0.1), "seen", [0.8, 0.2, 0.2, 1.0]
    )
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "ground", friction
    )
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform([0.0, 0.0, 0.1]))
    plant.Finalize()
    if not watched:
        return builder, plant, graph, None
    watch = builder.AddNamedSystem("watch", Watch(plant))
    builder.Connect(plant.get_state_output_port(), watch.get_input_port())
    return builder, plant, graph, watch


NAMES = ("stage", "speed", "word", "number", "pose")


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """The folder of a recording of half a second, without an arm or a gripper."""
    folder = tmp_path_factory.mktemp("recording") / "falling"
    builder, plant, graph, watch = falling_box()
    ports = {name: watch.GetOutputPort(name) for name in NAMES}
    ports["vertical speed [m/s]"] = ports.pop("speed")
    cameras = {name: add_camera(builder, graph, name) for name in ("front", "back")}
    with AddRecording(
        builder, plant, graph, folder, ports=ports, cameras=cameras, objects=["box"]
    ):
        simulator = Simulator(builder.Build())
        simulator.Initialize()
        simulator.AdvanceTo(0.5)
    return folder


def test_every_file_is_there(out):
    files = {path.name for path in out.iterdir()}
    assert files == {*FILES.values(), "video_back.mp4"}


def test_the_log_has_a_row_per_period_of_every_port(out):
    log = read_log(out / "log.npz")
    np.testing.assert_allclose(log["time"], 0.02 * np.arange(26), atol=1e-12)
    assert {"falls", "lies"} == set(log["stage"])
    assert {"up", "down"} == set(log["word"])
    falling = log["stage"] == "falls"
    assert np.all((log["vertical speed [m/s]"][:, 0] < -0.01) == falling)
    np.testing.assert_array_equal(log["number"], log["vertical speed [m/s]"][:, 0])
    assert log["pose"].shape == (26, 7)


def test_the_first_text_shades_and_the_others_are_panels(out):
    timeline = read_run(out).timeline
    assert timeline.mode[0] == "lies"
    assert "falls" in timeline.mode
    labels = [label for label, _, _ in timeline.panels]
    assert labels == ["word", "number", "pose", "vertical speed\n[m/s]"]
    _, values, names = timeline.panels[0]
    assert names == ["up", "down"]
    np.testing.assert_array_equal(values.sum(axis=1), 1.0)


def test_the_page_has_scene_plots_and_video(out):
    page = (out / "replay.html").read_text()
    assert 'id="video"' in page
    assert "vertical speed" in page
    document, _ = read_glb(read_run(out).glb)
    names = [node.get("name") for node in document["nodes"]]
    assert "box::body" in names
    assert "front" in names
    assert any(name.startswith("force of ") for name in names)


def test_the_rosbag_has_a_topic_per_port_and_the_scene(out):
    with AnyReader([out / "recording.mcap"]) as reader:
        types = {c.topic: c.msgtype for c in reader.connections}
        counts = {c.topic: c.msgcount for c in reader.connections}
        said = [
            reader.deserialize(raw, c.msgtype).data
            for c, _, raw in reader.messages()
            if c.topic == "/stage"
        ]
    assert types == {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/stage": "std_msgs/msg/String",
        "/word": "std_msgs/msg/String",
        "/number": "std_msgs/msg/Float64",
        "/pose": "geometry_msgs/msg/PoseStamped",
        "/vertical_speed": "std_msgs/msg/Float64",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/scene": "visualization_msgs/msg/MarkerArray",
    }
    assert counts["/tf"] == 25
    assert counts["/scene"] == 1
    assert set(said) == {"falls", "lies"}


def test_the_video_has_an_image_per_frame(out):
    frames = cv2.VideoCapture(str(out / "video.mp4"))
    assert frames.get(cv2.CAP_PROP_FRAME_COUNT) == 10


@contextlib.contextmanager
def recorded(folder, port):
    """Record a port of the watch, and return the diagram."""
    builder, plant, graph, watch = falling_box()
    ports = {port: watch.GetOutputPort(port)}
    with AddRecording(builder, plant, graph, folder, ports=ports):
        yield builder.Build()


def test_modes_alone_make_a_page(tmp_path):
    with recorded(tmp_path, "stage") as diagram:
        Simulator(diagram).AdvanceTo(0.1)
    timeline = read_run(tmp_path).timeline
    assert [label for label, _, _ in timeline.panels] == ["stage"]
    assert "falls" in (tmp_path / "replay.html").read_text()


def test_numbers_alone_and_what_led_to_an_error_make_a_page(tmp_path):
    with pytest.raises(ZeroDivisionError), recorded(tmp_path, "speed") as diagram:
        Simulator(diagram).AdvanceTo(0.1)
        raise ZeroDivisionError
    assert read_run(tmp_path).timeline.mode == ()
    assert len(read_log(tmp_path / "log.npz")["time"]) == 6
    assert (tmp_path / "replay.html").exists()
    assert (tmp_path / "recording.mcap").exists()


def test_what_is_never_simulated_leaves_no_page(tmp_path):
    with recorded(tmp_path, "speed"):
        pass
    assert not (tmp_path / "replay.html").exists()


def test_a_second_run_of_the_same_diagram_is_refused(tmp_path):
    with recorded(tmp_path, "speed") as diagram:
        Simulator(diagram).AdvanceTo(0.1)
        with pytest.raises(RuntimeError, match=r"time went back from 0.1 to 0 s"):
            Simulator(diagram).AdvanceTo(0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.0}, "period: must be positive, got 0.0"),
        ({"frame_rate": -1.0}, "frame_rate: must be positive"),
        ({"ports": {}}, "ports: needs at least one port"),
        ({"ports": ("other",)}, r"ports: other: cannot record a list \(allowed: a vec"),
    ],
)
def test_bad_arguments_are_named(tmp_path, change, message):
    builder, plant, graph, watch = falling_box()
    if isinstance(change.get("ports"), tuple):
        change = {"ports": {n: watch.GetOutputPort(n) for n in change["ports"]}}
    arguments = {"ports": {"speed": watch.GetOutputPort("speed")}, **change}
    with pytest.raises(ValueError, match=message):
        AddRecording(builder, plant, graph, tmp_path / "out", **arguments)
    assert not (tmp_path / "out").exists()


FORGOTTEN = """
from pathlib import Path
from test_recording import falling_box
from drake_srg.recording.recording import AddRecording
from pydrake.systems.analysis import Simulator

def run(out):
    builder, plant, graph, watch = falling_box()
    ports = {"speed": watch.GetOutputPort("speed")}
    recording = AddRecording(builder, plant, graph, Path(out), ports=ports)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.1)
    return simulator

run("freed")
kept = run("kept")
"""


def test_a_forgotten_recording_is_completed_and_told(tmp_path):
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    program = f"import sys; sys.path[:0] = {paths!r}\n{FORGOTTEN}"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    files = {"log.npz", "timeline.png", "replay.glb", "replay.html", "recording.mcap"}
    for folder in ("freed", "kept"):
        assert f"{folder}: completed only now" in done.stderr
        assert {path.name for path in (tmp_path / folder).iterdir()} == files


def test_a_recorded_diagram_is_freed(leaked, tmp_path):
    def run():
        builder, plant, graph, _ = falling_box(watched=False)
        ports = {"state": plant.get_state_output_port()}
        with AddRecording(builder, plant, graph, tmp_path, ports=ports):
            Simulator(builder.Build()).AdvanceTo(0.1)

    run()
    assert leaked() == []
