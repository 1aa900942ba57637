"""Videos from cameras, encoded as H.264."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.geometry import RenderCameraCore
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.recording.output import Recorder, require
from drake_srg.types import mode_words

_BESIDE = 0.06  # distance of an object's name from its origin, in the image's x [m]
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LAST_FRAME = 1.5  # time for which the verdict is shown [s]
_GOOD, _BAD = (150, 235, 160), (255, 150, 130)  # colours of verdicts, RGB

# Names to write into an image, each with the pixel (x, y) of its lower left corner.
Names = list[tuple[str, tuple[int, int]]]


@dc.dataclass(frozen=True, eq=False)
class View:
    """The projection of a fixed pinhole camera.

    Args:
        core: Intrinsics, and the pose of the sensor X_BS.
        X_WB: Pose of the camera in world.
        kinds: Words to show in place of objects' names, by name.
    """

    core: RenderCameraCore
    X_WB: RigidTransform
    kinds: Mapping[str, str] = dc.field(default_factory=dict)

    def names(self, poses: Mapping[str, RigidTransform]) -> Names:
        """Return the names of visible objects at places where they do not overlap.

        Args:
            poses: Poses X_WO of the objects by name.
        """
        lens = self.core.intrinsics()
        X_WS = self.X_WB @ self.core.sensor_pose_in_camera_body()
        places = []
        for name, X_WO in poses.items():
            x, y, z = X_WS.inverse() @ X_WO.translation()
            if z < self.core.clipping().near():
                continue
            u = lens.focal_x() * (x + _BESIDE) / z + lens.center_x()
            v = lens.focal_y() * y / z + lens.center_y()
            if 0.0 <= u < lens.width() and 0.0 <= v < lens.height():
                places.append((v, u, self.kinds.get(name, name).replace("_", " ")))
        names: Names = []
        line, length = lens.height() / 32, lens.height() / 7
        for top, u, name in sorted(places):
            v = top
            for _, (x, y) in names:
                if abs(u - x) < length and abs(v - y) < line:
                    v = y + line
            names.append((name, (round(u), round(v))))
        return names


class VideoFile:
    """An MP4 file that plays in any browser; see `VideoRecorder` for the arguments.

    Attributes:
        frames: Number of images so far.
    """

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        frame_rate: float,
    ):
        if width < 2 or height < 2 or frame_rate <= 0:
            raise ValueError(
                "VideoRecorder: width and height must be at least 2 pixels and "
                f"frame_rate greater than 0, got width={width}, height={height}, "
                f"frame_rate={frame_rate}"
            )
        self._av = require("av")
        self._size, self._name = (width, height), path.name
        self._last: npt.NDArray[Any] | None = None
        self._container = self._av.open(
            str(path), "w", options={"movflags": "faststart"}
        )
        rate = Fraction(frame_rate).limit_denominator(1000)
        self._tick = 1 / rate
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.width, self._stream.height = width // 2 * 2, height // 2 * 2
        self._stream.pix_fmt = "yuv420p"
        # At some sizes, x264's macroblock tree (mbtree) reads uninitialized memory, so
        # equal images would give different bytes.
        self._stream.options = {
            "crf": "23",  # x264's default
            "preset": "veryfast",
            "x264-params": "mbtree=0",
        }
        # The number of threads changes the bytes. One thread works on every machine.
        self._stream.codec_context.thread_count = 1
        self.frames = 0

    def add(
        self,
        image: npt.NDArray[np.uint8],
        time: float,
        words: object = None,
        names: Iterable[tuple[str, tuple[int, int]]] = (),
        inset: npt.NDArray[np.uint8] | None = None,
    ) -> None:
        """Add an image.

        Args:
            image: RGBA, shape (height, width, 4).
            time: Simulated time [s], for the caption.
            words: Caption; see `caption`. None: no caption.
            names: Names to write into the image; see `View.names`.
            inset: A smaller RGBA image for the upper left corner.
        """
        width, height = self._size
        if image.shape[:2] != (height, width):
            raise ValueError(
                f"VideoRecorder: color_image must be {width}x{height} pixels like "
                f"{self._name}, got {image.shape[1]}x{image.shape[0]}"
            )
        even = image[: height // 2 * 2, : width // 2 * 2]
        # Faster than slicing.
        rgb: npt.NDArray[Any] = cv2.cvtColor(even, cv2.COLOR_RGBA2RGB)
        for name, (x, y) in names:
            for shift in ((-1, -1), (1, -1), (-1, 1), (1, 1)):  # an outline
                corner = (x + shift[0], y + shift[1])
                cv2.putText(rgb, name, corner, _FONT, height / 900, (255, 255, 255))
            cv2.putText(rgb, name, (x, y), _FONT, height / 900, (40, 40, 40))
        if inset is not None:
            rows, columns = min(inset.shape[0], height), min(inset.shape[1], width)
            part = rgb[:rows, :columns]
            part[:] = inset[:rows, :columns, :3]
            part[-2:] = part[:, -2:] = 255
        if words is not None:
            caption(rgb, time, words)
        self._last = rgb
        self._encode(rgb)

    def hold(self, success: bool, verdict: str) -> None:
        """Show the last image for another 1.5 s, with a verdict as its caption."""
        if self._last is None:
            return
        rgb = self._last.copy()
        strip = rgb[-max(1, len(rgb) // 15) :]
        strip[:] = 0
        write_line(strip, verdict, _GOOD if success else _BAD, 2)
        for _ in range(max(1, round(_LAST_FRAME / self._tick))):
            self._encode(rgb)

    def _encode(self, rgb: npt.NDArray[Any]) -> None:
        frame = self._av.VideoFrame.from_ndarray(rgb, format="rgb24")
        frame.pts = self.frames
        frame.time_base = self._tick
        self._container.mux(self._stream.encode(frame))
        self.frames += 1

    def close(self) -> None:
        """Complete the file."""
        if self.frames:
            self._container.mux(self._stream.encode(None))
        self._container.close()


def caption(image: npt.NDArray[Any], time: float, text: Any) -> None:
    """Write time and text along the lower edge of an image.

    Args:
        image: RGB, shape (height, width, 3); changed in place.
        time: Simulated time [s].
        text: A string, or a mode, which becomes its name.
    """
    height = image.shape[0]
    strip = image[-max(1, height // 15) :]
    write_line(strip, f"{time:6.2f} s  {mode_words(text)}", (255, 255, 255), 1)


def write_line(
    strip: npt.NDArray[Any], line: str, color: tuple[int, int, int], thickness: int
) -> None:
    """Darken a strip of an image, and write a line into it.

    Args:
        strip: RGB, shape (height, width, 3); changed in place.
        line: The text; long texts are scaled down.
        color: RGB.
        thickness: Thickness of the strokes [pixels].
    """
    strip[:] = strip // 3  # keeps the text legible on any background
    height, width = strip.shape[:2]
    margin, scale = height * 3 // 8, height * 3 / 140
    (length, _), _ = cv2.getTextSize(line, _FONT, scale, thickness)
    scale *= min(1.0, (width - 2 * margin) / length)
    place = (margin, height * 7 // 10)
    pixels = np.ascontiguousarray(strip)
    cv2.putText(pixels, line, place, _FONT, scale, color, thickness, cv2.LINE_AA)
    strip[:] = pixels


class CaptionedRecorder(Recorder):
    """Base class of recorders that write into a camera's images."""

    _view: View | None = None
    _verdict: tuple[bool, str] | None = None

    def judge(self, success: bool, verdict: str) -> None:
        """Let the video end with a verdict; see `VideoFile.hold`."""
        self._verdict = success, verdict

    def _declare_texts(self, view: View | None, caption: AbstractValue | None) -> None:
        """Declare the ports `caption` and `object_poses`."""
        self._view = view
        self._caption = self.DeclareAbstractInputPort(
            name="caption", model_value=caption or AbstractValue.Make(object())
        )
        self._poses = self.DeclareAbstractInputPort(
            name="object_poses", model_value=AbstractValue.Make({})
        )

    def _names(self, context: Context) -> Names:
        if self._view is None or not self._poses.HasValue(context):
            return []
        return self._view.names(self._poses.Eval(context))


class VideoRecorder(CaptionedRecorder):
    """Writes a camera's images into an MP4 file that plays in any browser.

    .. pydrake_system::

        name: VideoRecorder
        input_ports:
        - color_image
        - caption (optional)
        - object_poses (optional)
        - inset (optional)

    `color_image` is an ImageRgba8U. It is sampled every 1 / `frame_rate` of simulated
    time, first after one such period, so video time is simulated time minus one period.
    If `caption` is connected, every frame shows the time and the caption, a string or
    the name of a mode. `object_poses` is a dict of poses X_WO by name: with a `view`,
    the names appear beside the objects. `inset`, a smaller ImageRgba8U, covers the
    upper left corner.

    The video appears under its name on `close()`. Use the recorder as a context manager
    around the simulation, so that it is closed even after an error. The encoder is
    outside the Context, like every effect of a publish event: a context that is
    simulated twice is recorded twice. Equal images give equal bytes.

    Args:
        path: The .mp4 file.
        width: Width of the images [pixels]; an odd last column is left out.
        height: Height of the images [pixels]; an odd last row is left out.
        frame_rate: Images per simulated second [Hz].
        caption: Model value of the port `caption`; None: a Python object, such as an
            enum. `AbstractValue.Make("")` takes Drake's strings.
        view: Projection of the camera; None: no names.

    Raises:
        OSError: If the file cannot be written.
        ValueError: If a number is out of range.
    """

    def __init__(
        self,
        path: Path | str,
        width: int,
        height: int,
        *,
        frame_rate: float = 20.0,
        caption: AbstractValue | None = None,
        view: View | None = None,
    ):
        super().__init__()
        self._begin(path)
        try:
            self._file = VideoFile(self._output.path, width, height, frame_rate)
        except BaseException:
            self._closed = True
            self._output.discard()
            raise
        self._image = self.DeclareAbstractInputPort(
            name="color_image", model_value=AbstractValue.Make(ImageRgba8U())
        )
        self._declare_texts(view, caption)
        self._inset = self.DeclareAbstractInputPort(
            name="inset", model_value=AbstractValue.Make(ImageRgba8U())
        )
        period = 1.0 / frame_rate
        self.DeclarePeriodicPublishEvent(period, period, self._record)

    @property
    def frames(self) -> int:
        """Number of images recorded so far."""
        return self._file.frames

    def _finish(self) -> bool:
        if self._verdict is not None:
            self._file.hold(*self._verdict)
        self._file.close()
        return self.frames > 0

    def _record(self, context: Context) -> None:
        if self._closed:
            raise RuntimeError(f"{self.path}: the recorder is closed; make a new one")
        words = self._caption.Eval(context) if self._caption.HasValue(context) else None
        inset = None
        if self._inset.HasValue(context):
            inset = self._inset.Eval(context).data
        image, time = self._image.Eval(context).data, context.get_time()
        self._file.add(image, time, words, self._names(context), inset)
