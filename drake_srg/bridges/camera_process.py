"""Cameras rendered in a separate process, in parallel with the simulation."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Collection
from multiprocessing.connection import Connection
from typing import Any

from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed
from pydrake.systems.framework import DiagramBuilder

from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.topics import BLOBS, CAMERA_INFO, COLOR, DEPTH, OBJECT_POSE
from drake_srg.cell.perception import AddLocalizer
from drake_srg.common.ports import export_outputs
from drake_srg.common.processes import Companion
from drake_srg.common.real_time import lower_priority
from drake_srg.scenario import Scenario
from drake_srg.station.cameras import MakeRemoteCameras
from drake_srg.types import Vector

# Called with a picture's time [s], its topic and the values that `convert` takes.
Show = Callable[[float, str, tuple[Any, ...]], None]


class CameraProcess:
    """Renders a camera's pictures and runs the localizer for a given plant state.

    Args:
        scenario: The plant's scenario. It must not have soft objects, whose shape
            is not part of the state vector.
        camera: Name of the camera to render.
        state: Initial state of the plant, with which the renderers warm up.
        show: Called with each picture, in a thread of this object. Must not raise.
        warnings: Where failures are reported.
    """

    def __init__(
        self,
        scenario: Scenario,
        camera: str,
        state: Vector,
        show: Show,
        warnings: Warnings,
    ):
        self._show, self._warnings = show, warnings
        self._idle = threading.Event()
        arguments = (yaml_dump_typed(scenario), camera, state)
        self._process = Companion(
            "cameras", _render, arguments, self._receive, self._end
        )

    @property
    def idle(self) -> bool:
        """Whether the next `look` starts at once."""
        return self._idle.is_set()

    def look(self, time: float, state: Vector, topics: Collection[str]) -> None:
        """Start rendering `topics` for a state of the plant at `time` [s].

        Does nothing while the process is busy, and for an empty `topics`.
        """
        if topics and self._idle.is_set():
            self._idle.clear()
            self._process.send((time, state, set(topics)))

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def _receive(self, message: tuple[float, dict[str, tuple[Any, ...]]]) -> None:
        time, pictures = message
        for topic, values in pictures.items():
            self._show(time, topic, values)
        self._idle.set()

    def _end(self) -> None:
        self._idle.clear()
        self._warnings.warn(
            "cameras end", "the camera process has ended: no more pictures"
        )


def _render(connection: Connection, scenario: str, camera: str, state: Vector) -> None:
    """Run the process: render whenever the connection asks for it."""
    lower_priority()
    os.environ.setdefault("LP_NUM_THREADS", "0")  # leaves the other cores alone
    viewer = Viewer(yaml_load_typed(schema=Scenario, data=scenario), camera)
    # Renderers initialize themselves the first time they render.
    viewer.look(0.0, state, {COLOR, DEPTH, BLOBS})
    with contextlib.suppress(EOFError, OSError):  # the parent is gone
        connection.send((0.0, {}))  # ready
        while True:
            time, state, topics = connection.recv()
            connection.send((time, viewer.look(time, state, topics)))


class Viewer:
    """A diagram with the cameras and the localizer alone.

    Args:
        scenario: The plant's scenario, without soft objects.
        camera: Name of the camera to render.
    """

    def __init__(self, scenario: Scenario, camera: str) -> None:
        builder = DiagramBuilder()
        cameras = builder.AddNamedSystem("cameras", MakeRemoteCameras(scenario))
        builder.ExportInput(cameras.GetInputPort("state"), "state")
        export_outputs(builder, cameras)
        if scenario.localizer.cameras:
            localizer = AddLocalizer(builder, scenario, cameras)
            builder.ExportOutput(localizer.GetOutputPort("blobs"), "blobs")
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._camera = camera

    def look(
        self, time: float, state: Vector, topics: Collection[str]
    ) -> dict[str, tuple[Any, ...]]:
        """Return the values for each topic's `convert` (see `camera_topics`)."""
        self._context.SetTime(time)
        self._diagram.GetInputPort("state").FixValue(self._context, state)
        values: dict[str, tuple[Any, ...]] = {}
        if CAMERA_INFO in topics:
            values[CAMERA_INFO] = ()
        if COLOR in topics:
            values[COLOR] = (self._image("color")[..., :3].copy(),)
        if DEPTH in topics:
            values[DEPTH] = (self._image("depth")[..., 0].copy(),)
        for name in (BLOBS, OBJECT_POSE):
            if name in topics and self._diagram.HasOutputPort("blobs"):
                port = self._diagram.GetOutputPort("blobs")
                values[name] = (port.Eval(self._context),)
        return values

    def _image(self, kind: str) -> Any:
        port = self._diagram.GetOutputPort(f"camera_{self._camera}.{kind}_image")
        return port.Eval(self._context).data
