"""Records a run for its replay."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Collection, Sequence
from pathlib import Path

from pydrake.systems.framework import Context, Diagram

from drake_srg.common.ports import output_ports
from drake_srg.lifetime import my_context
from drake_srg.recording.output import OutputFile
from drake_srg.recording.run_timeline import Labels
from drake_srg.replay.glb import write_glb
from drake_srg.replay.scene import SceneRecorder
from drake_srg.replay.sights import SightRecorder


class ReplayRecorder:
    """Samples scene, contact forces and what the localizer sees, for replay.glb.

    Args:
        root: The root diagram, with a SceneGraph in it.
        cell: The cell in it, with the ports of `MakeCell`'s; those that exist count.
        objects: Names of the objects, at which contact forces point.
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
        self._scene = SceneRecorder(root, objects)
        self._sights = SightRecorder(cell, cameras)
        self._contacts = output_ports(cell).get("contact_results_cheat")

    def sample(self, root: Context) -> None:
        """Add a sample, at the time of the root diagram's context."""
        context = my_context(self._cell, root)
        contacts = None if self._contacts is None else self._contacts.Eval(context)
        self._scene.sample(root, contacts)
        self._sights.sample(context)

    def write(
        self, path: Path, labels: Labels, video_camera: str, video_start: float
    ) -> Path:
        """Write the samples so far; there must be one.

        Args:
            path: The .glb file.
            labels: Names for the columns of the run's log.
            video_camera: Name of the camera of video.mp4; empty: no video.
            video_start: Simulated time of the video's first frame [s].

        Returns:
            The path.

        Raises:
            OSError: If the file cannot be written.
        """
        extras = {
            "labels": dc.asdict(labels),
            "video_camera": video_camera,
            "video_start": video_start,
            "sights": self._sights.sights,
        }
        output = OutputFile(path)
        output.path.write_bytes(
            write_glb(self._scene.nodes(), extras, self._sights.images)
        )
        return output.commit()
