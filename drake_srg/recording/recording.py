"""A recording of any diagram: video, rosbag, log, timeline and replay, in one call."""

from __future__ import annotations

import contextlib
import enum
import math
import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    InputPort,
    OutputPort,
    PortDataType,
)
from pydrake.systems.sensors import RgbdSensor

from drake_srg.common.log_format import pose_to_row
from drake_srg.lifetime import LeafSystem
from drake_srg.recording import rosbag
from drake_srg.recording.output import (
    Recorder,
    close_at_exit,
    close_late,
    output_folder,
    write_log,
)
from drake_srg.recording.replay.page import write_page
from drake_srg.recording.replay.recorder import write_replay
from drake_srg.recording.replay.scene import SceneRecorder
from drake_srg.recording.rosbag import RosbagRecorder, Topic
from drake_srg.recording.scene_topics import scene_topics
from drake_srg.recording.timeline import Labels, draw_timeline, run_timeline
from drake_srg.recording.video import VideoRecorder
from drake_srg.types import mode_name

# Files of a recording, by kind.
FILES = {
    "video": "video.mp4",
    "recording": "recording.mcap",
    "log": "log.npz",
    "timeline": "timeline.png",
    "replay_glb": "replay.glb",
    "replay": "replay.html",
}


class SignalLog:
    """A log of ports by name: vectors, numbers, poses, strings and modes."""

    def __init__(self, ports: Mapping[str, InputPort | OutputPort]) -> None:
        self._ports = dict(ports)
        self._rows: list[dict[str, Any]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def sample(self, context: Context) -> None:
        """Add a row; an exception adds nothing."""
        self._rows.append(self.row(context))

    def row(self, context: Context) -> dict[str, Any]:
        """Return time [s] and values; poses are rows of `pose_to_row`."""
        row: dict[str, Any] = {"time": context.get_time()}
        for name, port in self._ports.items():
            value = port.Eval(context)
            if isinstance(value, RigidTransform):
                row[name] = pose_to_row(value)
            elif isinstance(value, (enum.Enum, str)):
                row[name] = mode_name(value)
            else:
                row[name] = np.array(value, dtype=float)
        return row

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return one array per quantity, with one row per sample."""
        return {
            name: np.array([row[name] for row in self._rows]) for name in self._rows[0]
        }


class Recording:
    """The files of a simulation; use it as a context manager around the simulation.

    At the end, all files are completed, even after an error or the user's interrupt,
    because they show the cause. A recording that is never closed completes them, with a
    warning, when it is deleted or the program ends.

    Args:
        out: The folder; None: nothing is written.

    Attributes:
        write_samples: Function that writes the samples of the simulation into a folder
            and returns the paths by kind.
    """

    def __init__(self, out: Path | None) -> None:
        self.write_samples: Callable[[Path], Mapping[str, Path]] = lambda out: {}
        self._out, self._closed = out, False
        self._recorders: dict[str, Recorder] = {}
        self._written: dict[str, str] = {}
        close_at_exit(self, Recording._close_forgotten)

    def record(self, recorders: Mapping[str, Recorder]) -> None:
        """Also complete the files of these recorders, by kind."""
        self._recorders |= recorders

    def begin(self) -> None:
        """Remove the files of an earlier recording."""
        if self._out is not None:
            for file in (*FILES.values(), "metrics.json"):
                (self._out / file).unlink(missing_ok=True)
            for video in self._out.glob("video_*.mp4"):
                video.unlink()

    def complete(self) -> dict[str, str]:
        """Complete all files but replay.html, and return their paths by kind.

        Later calls only return the paths.

        Raises:
            OSError: If a file cannot be written.
        """
        if self._closed:
            return self._written
        self._closed = True
        # Write samples first, because another process may be completing the video.
        try:
            if self._out is not None:
                samples = self.write_samples(self._out)
                self._written |= {kind: str(path) for kind, path in samples.items()}
        finally:
            with contextlib.ExitStack() as stack:  # closes all, even if one raises
                for recorder in self._recorders.values():
                    stack.callback(recorder.close)
        for kind, recorder in self._recorders.items():
            if recorder.path.exists():
                self._written[kind] = str(recorder.path)
        return self._written

    def write_page(self) -> Path | None:
        """Write replay.html; None if no scene has been sampled.

        Raises:
            OSError: If the file cannot be written.
        """
        if self._out is None or "replay_glb" not in self._written:
            return None
        return write_page(self._out)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.complete()
            self.write_page()
            return
        # Report only the first error: a full disk would raise again here.
        if not self._closed:
            for recorder in self._recorders.values():
                recorder.note_failure(kind)
            with contextlib.suppress(Exception):
                self.complete()
        with contextlib.suppress(Exception):
            self.write_page()

    def _close_forgotten(self) -> str:
        if self._closed:
            return ""
        written = self.complete()
        if not written:
            return ""
        self.write_page()
        return str(self._out)

    def __del__(self) -> None:
        close_late(lambda: self, Recording._close_forgotten)


def write_samples(
    out: Path,
    log: Mapping[str, npt.NDArray[Any]],
    labels: Labels,
    write_glb: Callable[[Path], Path] | None,
) -> dict[str, Path]:
    """Write log.npz and, with `write_glb`, timeline.png and replay.glb.

    Returns:
        Paths of the files by kind.

    Raises:
        OSError: If a file cannot be written.
    """
    written = {"log": write_log(out / FILES["log"], log)}
    if write_glb is not None:
        timeline = run_timeline(log, labels)
        written["timeline"] = draw_timeline(timeline, out / FILES["timeline"])
        written["replay_glb"] = write_glb(out / FILES["replay_glb"])
    return written


def AddRecording(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    out: Path | str,
    *,
    ports: Mapping[str, OutputPort],
    cameras: Mapping[str, RgbdSensor] | None = None,
    objects: Collection[str] = (),
    period: float = 0.02,
    frame_rate: float = 20.0,
    title: str = "",
) -> Recording:
    """Add the recording of a diagram, and return it as a context manager.

    Enter it around the simulation::

        with AddRecording(builder, plant, scene_graph, "out", ports=ports):
            simulator = Simulator(builder.Build())
            simulator.AdvanceTo(5.0)

    At the end, the folder has log.npz, timeline.png, replay.glb, replay.html and
    recording.mcap (a topic per port, /clock, /tf and /scene), and video.mp4 if there is
    a camera. The values of the first port with strings or modes shade the plots and
    caption the video.

    Args:
        builder: Builder of the diagram with all systems.
        plant: The plant, finalized.
        scene_graph: Its scene.
        out: The folder; it is made if it does not exist.
        ports: Name in log, plots and topics to output port: a vector, a number, a
            string, a mode (an enum) or a RigidTransform. Give a unit with the name:
            "hand.wire_force [N]" has the topic /hand/wire_force.
        cameras: Cameras by name. The first one's images become video.mp4, those of any
            other video_NAME.mp4.
        objects: Names of model instances; in the replay, arrows show forces on them.
        period: Time between samples, and between messages [s].
        frame_rate: Images of each camera per simulated second [Hz].
        title: Title of the plots and the page; "": the folder's name.

    Raises:
        OSError: If the folder cannot be written.
        ValueError: If the plant is not finalized, a number is not positive, there are
            no ports, or a port's values cannot be recorded.
    """
    out, cameras = Path(out), dict(cameras or {})
    if not plant.is_finalized():
        raise ValueError("AddRecording: plant: must be finalized first")
    for name, value in (("period", period), ("frame_rate", frame_rate)):
        if not 0.0 < value < math.inf:
            raise ValueError(f"AddRecording: {name}: must be positive, got {value}")
    if not ports:
        raise ValueError("AddRecording: ports: needs at least one port")
    topics = [_topic(name, port) for name, port in ports.items()]
    poses = plant.get_body_poses_output_port()
    inspector = scene_graph.model_inspector()
    topics += scene_topics(plant, inspector, "body_poses", poses.Allocate(), period)
    senses = {
        "query_object": scene_graph.get_query_output_port(),
        "contact_results": plant.get_contact_results_output_port(),
    }
    scene = SceneRecorder(scene_graph, cameras, objects)
    recording = Recording(out)
    sampler = _Sampler(recording, ports, scene, senses, period)
    log = sampler.log
    labels = Labels(title or out.resolve().name, signals=tuple(ports))
    video_camera = next(iter(cameras), "")

    def write(out: Path) -> dict[str, Path]:
        def write_glb(path: Path) -> Path:
            return write_replay(path, scene, labels, video_camera, 1.0 / frame_rate)

        return write_samples(out, log.arrays(), labels, write_glb) if log else {}

    recording.write_samples = write
    texts = [p for p in ports.values() if isinstance(_model(p), (str, enum.Enum))]
    with output_folder(out), contextlib.ExitStack() as stack:
        recorders: dict[str, Recorder] = {}
        for number, (name, camera) in enumerate(cameras.items()):
            kind = f"video_{name}" if number else "video"
            core = camera.default_color_render_camera().core()
            size = (core.intrinsics().width(), core.intrinsics().height())
            video = VideoRecorder(
                out / f"{kind}.mp4",
                *size,
                frame_rate=frame_rate,
                caption=texts[0].Allocate() if texts else None,
            )
            recorders[kind] = stack.enter_context(video)
            builder.AddNamedSystem(f"{kind}_recorder", video)
            builder.Connect(
                camera.GetOutputPort("color_image"), video.get_input_port(0)
            )
            if texts:
                builder.Connect(texts[0], video.GetInputPort("caption"))
        bag = RosbagRecorder(
            out / FILES["recording"], [rosbag.clock(), *topics], period=period
        )
        recorders["recording"] = stack.enter_context(bag)
        builder.AddNamedSystem("rosbag_recorder", bag)
        builder.AddNamedSystem("sampler", sampler)
        for name, port in {**ports, "body_poses": poses}.items():
            builder.Connect(port, bag.GetInputPort(name))
        for name, port in {**ports, **senses}.items():
            builder.Connect(port, sampler.GetInputPort(name))
        stack.pop_all()
    recording.record(recorders)
    return recording


def _model(port: OutputPort) -> Any:
    """Return a value of a port's type."""
    if port.get_data_type() == PortDataType.kVectorValued:
        return np.zeros(port.size())
    return port.Allocate().get_value()


def _topic(name: str, port: OutputPort) -> Topic:
    """Return the topic of a port.

    Raises:
        ValueError: If no topic type holds its values.
    """
    words = re.sub(r"[^A-Za-z0-9.]+", "_", name.split("[", maxsplit=1)[0]).strip("_")
    topic = "/" + words.replace(".", "/")
    value = _model(port)
    if isinstance(value, np.ndarray):
        size = len(value)
        if size == 1:
            return rosbag.float64(topic, name)
        return rosbag.float64_array(topic, name, size)
    if isinstance(value, (str, enum.Enum)):
        return rosbag.string(topic, name, port.Allocate())
    if isinstance(value, (bool, int, float)):
        return rosbag.float64(topic, name, port.Allocate())
    if isinstance(value, RigidTransform):
        kind = "geometry_msgs/msg/PoseStamped"
        return Topic(topic, kind, {name: port.Allocate()}, rosbag.pose_message)
    raise ValueError(
        f"AddRecording: ports: {name}: cannot record a {type(value).__name__} "
        "(allowed: a vector, a number, a string, an enum, a RigidTransform; name "
        "cameras in `cameras`)"
    )


class _Sampler(LeafSystem):
    """Samples ports and the scene at every multiple of a period.

    The samples are not in the Context, because they grow during the simulation, and
    each clone of a context would copy them all. So a context that is simulated twice is
    recorded twice. The sampler keeps its recording alive, but not the reverse. So an
    unused diagram can be freed, and its recording then completes the files.

    Args:
        recording: The recording; the first sample begins it.
        ports: The ports to log, by name.
        scene: Samples the scene.
        senses: The ports that `scene` samples.
        period: Time between samples [s].

    Attributes:
        log: The samples of the ports.
    """

    def __init__(
        self,
        recording: Recording,
        ports: Mapping[str, OutputPort],
        scene: SceneRecorder,
        senses: Mapping[str, OutputPort],
        period: float,
    ) -> None:
        super().__init__()
        for name, port in {**ports, **senses}.items():
            if port.get_data_type() == PortDataType.kVectorValued:
                self.DeclareVectorInputPort(name, port.size())
            else:
                self.DeclareAbstractInputPort(name, port.Allocate())
        self.log = SignalLog({name: self.GetInputPort(name) for name in ports})
        self._recording, self._scene, self._latest = recording, scene, -math.inf
        self.DeclarePeriodicPublishEvent(period, 0.0, self._sample)

    def _sample(self, context: Context) -> None:
        time = context.get_time()
        if time == self._latest:
            return  # a simulator that is initialized twice publishes twice
        if time < self._latest:
            raise RuntimeError(
                f"the time went back from {self._latest:g} to {time:g} s during a "
                "recording: build a new diagram and recording for each run"
            )
        if not self.log:
            self._recording.begin()
        self._latest = time
        self.log.sample(context)
        contacts = self.GetInputPort("contact_results").Eval(context)
        query = self.GetInputPort("query_object").Eval(context)
        self._scene.sample(time, query, contacts)
