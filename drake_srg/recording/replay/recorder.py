"""Recorders for replay.glb: of a run's scene, and of the localizer's images."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.systems.framework import Context, Diagram, System
from pydrake.systems.sensors import RgbdSensor

from drake_srg.common.systems import output_ports
from drake_srg.lifetime import my_context
from drake_srg.recording.output import OutputFile
from drake_srg.recording.replay.glb import Json, write_glb
from drake_srg.recording.replay.scene import SceneRecorder
from drake_srg.recording.timeline import Labels

_WIDTH = 640  # pixels; larger images are scaled down


class SightRecorder:
    """Keeps the localizer's images and blobs at each look of the planner.

    Args:
        cell: A cell with the ports of `MakeCell`. Without the port `planner.status`,
            nothing is kept.
        cameras: Names of the localizer's cameras.

    Attributes:
        sights: Looks, each with time [s], camera, index of the image and, if the cell
            has a localizer, blobs.
        images: JPEG files.
    """

    def __init__(self, cell: Diagram, cameras: Sequence[str]) -> None:
        ports = output_ports(cell)
        self._status = ports.get("planner.status")
        self._cameras = {
            name: ports[port]
            for name in cameras
            if (port := f"camera_{name}.color_image") in ports
        }
        self._localizes = "localizer.blobs" in ports
        self._looks = 0
        self.sights: list[Json] = []
        self.images: list[bytes] = []

    def sample(self, context: Context) -> None:
        """Keep images and blobs if the planner has looked since the last sample.

        Args:
            context: The cell's context.
        """
        if self._status is None:
            return
        status = self._status.Eval(context)
        if status.looks == self._looks:
            return
        self._looks = status.looks
        for name, port in self._cameras.items():
            pixels = port.Eval(context).data
            sight: Json = {
                "time": context.get_time(),
                "camera": name,
                "image": len(self.images),
            }
            if self._localizes or status.blobs:
                sight["blobs"] = [
                    _blob(blob, pixels.shape)
                    for blob in status.blobs
                    if blob.camera == name
                ]
            self.sights.append(sight)
            self.images.append(_jpeg(pixels))


def _blob(blob: Any, shape: tuple[int, ...]) -> Json:
    """Return a blob's name, place (in shares of width and height) and quality."""
    (u, v), (height, width) = blob.pixel, shape[:2]
    return {
        "name": blob.object_name,
        "at": [round((u + 0.5) / width, 4), round((v + 0.5) / height, 4)],
        "quality": round(float(blob.quality), 3),
    }


def _jpeg(rgba: Any) -> bytes:
    """Return an RGBA image as a JPEG file."""
    bgr = cv2.cvtColor(np.asarray(rgba), cv2.COLOR_RGBA2BGR)
    height, width = bgr.shape[:2]
    if width > _WIDTH:
        size = (_WIDTH, round(height * _WIDTH / width))
        bgr = cv2.resize(bgr, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 80])
    return bytes(data)


class ReplayRecorder:
    """Samples scene, contact forces and the localizer's images for replay.glb.

    Args:
        root: The root diagram, with a SceneGraph in it.
        cell: The cell in it, with some of the ports of `MakeCell`.
        objects: Names of the objects; arrows show contact forces on them.
        cameras: Names of the localizer's cameras.

    Raises:
        ValueError: If the diagram has no SceneGraph.
    """

    def __init__(
        self,
        root: Diagram,
        cell: Diagram,
        objects: Collection[str] = (),
        cameras: Sequence[str] = (),
    ) -> None:
        self._cell = cell
        systems = list(_systems(root))
        graphs = [system for system in systems if isinstance(system, SceneGraph)]
        if not graphs:
            raise ValueError("ReplayRecorder needs a diagram with a SceneGraph")
        self._graph = graphs[0]
        sensors = [system for system in systems if isinstance(system, RgbdSensor)]
        named = {s.get_name().removeprefix("rgbd_sensor_"): s for s in sensors}
        self._scene = SceneRecorder(self._graph, named, objects)
        self._sights = SightRecorder(cell, cameras)
        self._contacts = output_ports(cell).get("contact_results_cheat")

    def sample(self, root: Context) -> None:
        """Add a sample, at the time of the root diagram's context."""
        context = my_context(self._cell, root)
        contacts = None if self._contacts is None else self._contacts.Eval(context)
        query = self._graph.get_query_output_port().Eval(my_context(self._graph, root))
        self._scene.sample(root.get_time(), query, contacts)
        self._sights.sample(context)

    def write(
        self, path: Path, labels: Labels, video_camera: str, video_start: float
    ) -> Path:
        """Write the samples so far; see `write_replay`."""
        seen = self._sights.sights, self._sights.images
        return write_replay(path, self._scene, labels, video_camera, video_start, *seen)


def _systems(diagram: Diagram) -> Iterator[System]:
    """Yield the systems of a diagram at any depth, except those within sensors."""
    for system in diagram.GetSystems():
        yield system
        if isinstance(system, Diagram) and not isinstance(system, RgbdSensor):
            yield from _systems(system)


def write_replay(
    path: Path,
    scene: SceneRecorder,
    labels: Labels,
    video_camera: str = "",
    video_start: float = 0.0,
    sights: Sequence[Json] = (),
    images: Sequence[bytes] = (),
) -> Path:
    """Write a scene and the localizer's images as replay.glb.

    Args:
        path: The .glb file.
        scene: Its samples; there must be one.
        labels: Names for the columns of the run's log.
        video_camera: Name of the camera of video.mp4; empty: no video.
        video_start: Simulated time of the video's first frame [s].
        sights: See `SightRecorder`.
        images: The images of `sights`.

    Returns:
        The path.

    Raises:
        OSError: If the file cannot be written.
    """
    extras = {
        "labels": labels.tree(),
        "video_camera": video_camera,
        "video_start": video_start,
        "sights": list(sights),
    }
    output = OutputFile(path)
    output.path.write_bytes(write_glb(scene.nodes(), extras, images))
    return output.commit()
