"""Videos of cameras, encoded as H.264."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.recording.output import Recorder, require
from drake_srg.types import mode_words


class VideoFile:
    """An MP4 file that plays in any browser.

    Equal images give equal bytes, except below 128 pixels, where x264's lookahead reads
    memory that it has not written.

    Args:
        path: The .mp4 file.
        width: Width of the images [pixels]; an odd last column is left out.
        height: Height of the images [pixels]; an odd last row is left out.
        frame_rate: Images per second [Hz].
        quality: Constant rate factor of x264, 0 (lossless) .. 51; 23 is its default.

    Attributes:
        frames: Number of images so far.

    Raises:
        ImportError: If PyAV is missing.
        OSError: If the file cannot be written.
        ValueError: If a number is out of range.
    """

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        frame_rate: float,
        quality: int = 23,
    ):
        if width < 2 or height < 2 or frame_rate <= 0 or not 0 <= quality <= 51:
            raise ValueError(
                "VideoRecorder: width and height must be at least 2 pixels, frame_rate "
                f"greater than 0 and quality 0 .. 51, got width={width}, "
                f"height={height}, frame_rate={frame_rate}, quality={quality}"
            )
        self._av = require("av")
        self._size, self._name = (width, height), path.name
        self._container = self._av.open(
            str(path), "w", options={"movflags": "faststart"}
        )
        rate = Fraction(frame_rate).limit_denominator(1000)
        self._tick = 1 / rate
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.width, self._stream.height = width // 2 * 2, height // 2 * 2
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"crf": str(quality), "preset": "veryfast"}
        # The number of threads changes the bytes; one gives the same on every machine.
        self._stream.codec_context.thread_count = 1
        self.frames = 0

    def add(
        self, image: npt.NDArray[np.uint8], time: float, words: object = None
    ) -> None:
        """Add an image.

        Args:
            image: RGBA, shape (height, width, 4).
            time: Simulated time [s], for the caption.
            words: Caption, see `caption`; None: no caption.
        """
        width, height = self._size
        if image.shape[:2] != (height, width):
            raise ValueError(
                f"VideoRecorder: color_image must be {width}x{height} pixels like "
                f"{self._name}, got {image.shape[1]}x{image.shape[0]}"
            )
        even = image[: height // 2 * 2, : width // 2 * 2]
        # Faster than the copy of a slice.
        rgb: npt.NDArray[Any] = cv2.cvtColor(even, cv2.COLOR_RGBA2RGB)
        if words is not None:
            caption(rgb, time, words)
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
        text: A string, or a mode, which is shown by its name.
    """
    line = f"{time:6.2f} s  {mode_words(text)}"
    height, width = image.shape[:2]
    strip = image[-max(1, height // 15) :]
    strip[:] = strip // 3  # keeps the text legible on any background
    margin, scale, font = height // 40, height / 700, cv2.FONT_HERSHEY_SIMPLEX
    (length, _), _ = cv2.getTextSize(line, font, scale, 1)
    scale *= min(1.0, (width - 2 * margin) / length)  # long reasons fit, too
    place = (margin, height - height // 50)
    cv2.putText(image, line, place, font, scale, (255, 255, 255), 1, cv2.LINE_AA)


class VideoRecorder(Recorder):
    """Writes a camera's images into an MP4 file that plays in any browser.

    .. pydrake_system::

        name: VideoRecorder
        input_ports:
        - color_image
        - caption (optional)

    `color_image` is an ImageRgba8U. It is sampled every 1 / `frame_rate` of simulated
    time, first after one such period, so video time is simulated time minus one period.
    If `caption` is connected, every frame shows the time and its value: a string, or a
    mode, shown by its name.

    The video appears under its name on `close()`. Use the recorder as a context manager
    around the simulation, which closes it also after an error. The encoder is outside
    the Context, like everything that a publish event does: simulating a context twice
    records it twice. Equal images give equal bytes, except below 128 pixels, where
    x264's lookahead reads memory that it has not written.

    Args:
        path: The .mp4 file.
        width: Width of the images [pixels]; an odd last column is left out.
        height: Height of the images [pixels]; an odd last row is left out.
        frame_rate: Images per simulated second [Hz].
        quality: Constant rate factor of x264, 0 (lossless) .. 51; 23 is its default.
        caption: Model value of the port `caption`; None: a Python object, such as an
            enum. `AbstractValue.Make("")` takes Drake's strings.

    Raises:
        ImportError: If PyAV is missing.
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
        quality: int = 23,
        caption: AbstractValue | None = None,
    ):
        super().__init__()
        self._begin(path)
        try:
            self._file = VideoFile(
                self._output.path, width, height, frame_rate, quality
            )
        except BaseException:
            self._closed = True
            self._output.discard()
            raise
        self._image = self.DeclareAbstractInputPort(
            name="color_image", model_value=AbstractValue.Make(ImageRgba8U())
        )
        self._caption = self.DeclareAbstractInputPort(
            name="caption", model_value=caption or AbstractValue.Make(object())
        )
        period = 1.0 / frame_rate
        self.DeclarePeriodicPublishEvent(period, period, self._record)

    @property
    def frames(self) -> int:
        """Number of images recorded so far."""
        return self._file.frames

    def _finish(self) -> bool:
        self._file.close()
        return self.frames > 0

    def _record(self, context: Context) -> None:
        if self._closed:
            raise RuntimeError(f"{self.path}: the recorder is closed; make a new one")
        words = self._caption.Eval(context) if self._caption.HasValue(context) else None
        self._file.add(self._image.Eval(context).data, context.get_time(), words)
