"""Records ROS topics in a rosbag."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Context

from drake_srg.lifetime import weak
from drake_srg.recording.output import OutputFile, Recorder, require
from drake_srg.recording.ros_topics import Topic


class RosbagRecorder(Recorder):
    """Writes topics into one rosbag2 file in MCAP format.

    .. pydrake_system::

        name: RosbagRecorder
        input_ports:
        - (the ports of all topics)

    A topic is recorded at every multiple of its period except 0, stamped with simulated
    time. The file contains the definitions of its messages, so
    `rosbags.rosbag2.Reader`, `ros2 bag info` and Foxglove open it without any other
    file. It appears under its name on `close()`. Use the recorder as a context manager
    around the simulation, which closes it also after an error.

    Args:
        path: The .mcap file.
        topics: The topics; see `drake_srg.recording.ros_topics`.
        period: Time between messages of topics without a period of their own [s].

    Raises:
        ImportError: If rosbags is missing.
        OSError: If the file cannot be written.
        ValueError: If there are no topics, one appears twice, a period is not positive,
            the file is not named .mcap, or two topics disagree on the type of a port.
    """

    def __init__(
        self, path: Path | str, topics: Sequence[Topic], *, period: float = 0.02
    ):
        super().__init__()
        path = Path(path)
        names = [topic.name for topic in topics]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                f"RosbagRecorder: topics must have unique names, got {names}"
            )
        if path.suffix != ".mcap":
            raise ValueError(
                f"RosbagRecorder: path must end in .mcap, got {path.name!r}"
            )
        for topic in topics:
            every = period if topic.period is None else topic.period
            if every <= 0:
                raise ValueError(
                    f"{topic.name}: period must be greater than 0, got {every}"
                )

        rosbag2, typesys = require("rosbags.rosbag2"), require("rosbags.typesys")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._output = OutputFile(path)
        # Writer makes a folder FOLDER/ with FOLDER.mcap in it.
        self._bag = self._output.path.with_suffix("")
        self._writer = rosbag2.Writer(
            self._bag, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP
        )
        self._writer.set_compression(
            rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD
        )
        self._writer.open()
        self._messages = 0

        record = weak(self._record)  # a closure over self would keep the recorder alive
        sizes: dict[str, object] = {}
        for topic in topics:
            self._declare_ports(topic, sizes)
            # Compiles how the type is written: up to 50 ms, which would otherwise hold
            # up a loop in real time.
            self._store.get_msgdef(topic.type)
            connection = self._writer.add_connection(
                topic.name, topic.type, typestore=self._store
            )
            every = period if topic.period is None else topic.period
            self.DeclarePeriodicPublishEvent(
                every,
                every,
                lambda context, t=topic, c=connection: record(context, t, c),
            )

    def _finish(self) -> bool:
        try:
            self._writer.close()
        except OSError as error:  # such as a full disk
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        (self._bag / self._output.path.name).replace(self._output.path)
        # An empty bag is kept if nothing failed.
        return self._messages > 0 or not self._failed

    def _declare_ports(self, topic: Topic, declared: dict[str, object]) -> None:
        for port, model in topic.ports.items():
            kind = model if isinstance(model, int) else type(model)
            if declared.setdefault(port, kind) != kind:
                raise ValueError(
                    f"{topic.name}: port {port!r} is {kind} here and "
                    f"{declared[port]} in another topic"
                )
            if self.HasInputPort(port):
                continue
            if isinstance(model, int):
                self.DeclareVectorInputPort(name=port, size=model)
            else:
                self.DeclareAbstractInputPort(name=port, model_value=model)

    def _record(self, context: Context, topic: Topic, connection: Any) -> None:
        if self._closed:
            raise RuntimeError(f"{self.path}: the recorder is closed; make a new one")
        values = []
        for name in topic.ports:
            port = self.GetInputPort(name)
            if port.HasValue(context):
                values.append(port.Eval(context))
            elif name in topic.optional:
                values.append(None)
            else:
                raise RuntimeError(
                    f"RosbagRecorder: input port {name!r} ({topic.name}) is not "
                    "connected"
                )
        message = topic.convert(self._make, context.get_time(), *values)
        if message is not None:
            self._writer.write(
                connection,
                round(context.get_time() * 1e9),
                self._store.serialize_cdr(message, topic.type),
            )
            self._messages += 1

    def _make(self, kind: str, *values: Any, **fields: Any) -> Any:
        return self._store.types[kind](*values, **fields)
