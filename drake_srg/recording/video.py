"""Records a camera as H.264 video."""

from __future__ import annotations

import enum
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.recording.output import OutputFile, Recorder, require


class VideoRecorder(Recorder):
    """Writes the images of a camera into an MP4 file that plays in any browser.

    .. pydrake_system::

        name: VideoRecorder
        input_ports:
        - color_image
        - caption (optional)

    `color_image` is an ImageRgba8U, sampled every 1 / `frame_rate` of simulated time
    and for the first time after one such period; video time is simulated time less
    that period. Where `caption` is connected, its value is written on every frame,
    behind the time: a string, or an enum such as `Mode`, shown by its value.

    The video appears under its name on `close()`, complete; use the recorder as a
    context manager around the simulation, which closes it on an error, too. The encoder
    is outside of the Context, like everything a publish event does: a context that is
    simulated twice is recorded twice. Equal images give equal bytes, except below 128
    pixels, where x264's lookahead reads memory that it has not written.

    Args:
        path: The .mp4 file.
        width: Of the images [pixels]; an odd last column is left out.
        height: Of the images [pixels]; an odd last row is left out.
        frame_rate: Images per simulated second [Hz].
        quality: Constant rate factor of x264, 0 (lossless) .. 51; 23 is its default.
        caption_model: The type of `caption`; AbstractValue.Make("") for ports that
            hold Drake's strings, the default for those that hold Python objects.

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
        caption_model: AbstractValue | None = None,
    ):
        super().__init__()
        if width < 2 or height < 2 or frame_rate <= 0 or not 0 <= quality <= 51:
            raise ValueError(
                f"VideoRecorder has width={width}, height={height}, frame_rate="
                f"{frame_rate}, quality={quality}; allowed are sizes of 2 or more "
                "pixels, a positive frame_rate and a quality of 0 .. 51"
            )
        self._av = require("av")
        self._size = (width, height)
        self._output = OutputFile(path)
        self._container = self._av.open(
            str(self._output.path), "w", options={"movflags": "faststart"}
        )
        rate = Fraction(frame_rate).limit_denominator(1000)
        self._tick = 1 / rate
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.width, self._stream.height = width // 2 * 2, height // 2 * 2
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"crf": str(quality), "preset": "veryfast"}
        # The number of threads changes the bytes; the same video on every machine.
        self._stream.codec_context.thread_count = 1
        self._frames = 0

        self._image = self.DeclareAbstractInputPort(
            name="color_image", model_value=AbstractValue.Make(ImageRgba8U())
        )
        self._caption = self.DeclareAbstractInputPort(
            name="caption", model_value=caption_model or AbstractValue.Make(object())
        )
        period = 1.0 / frame_rate
        self.DeclarePeriodicPublishEvent(period, period, self._record)

    @property
    def frames(self) -> int:
        """How many images have been recorded."""
        return self._frames

    def _finish(self) -> bool:
        if self._frames:
            self._container.mux(self._stream.encode(None))
        self._container.close()
        return self._frames > 0

    def _record(self, context: Context) -> None:
        if self._closed:
            raise RuntimeError(f"The video {self.path} is closed; make a new one")
        image = self._image.Eval(context).data
        width, height = self._size
        if image.shape[:2] != (height, width):
            raise ValueError(
                f"VideoRecorder.color_image is {image.shape[1]}x{image.shape[0]} "
                f"pixels; the video {self.path.name} is {width}x{height}"
            )
        even = image[: height // 2 * 2, : width // 2 * 2]
        rgb = cv2.cvtColor(even, cv2.COLOR_RGBA2RGB)  # faster than a slice's copy
        if self._caption.HasValue(context):
            caption(rgb, context.get_time(), self._caption.Eval(context))
        frame = self._av.VideoFrame.from_ndarray(rgb, format="rgb24")
        frame.pts = self._frames
        frame.time_base = self._tick
        self._container.mux(self._stream.encode(frame))
        self._frames += 1


def caption(image: npt.NDArray[np.uint8], time: float, text: Any) -> None:
    """Write time and text on the lower edge of an image.

    Args:
        image: RGB, shape (height, width, 3); is changed.
        time: [s].
        text: A string or an enum.
    """
    if isinstance(text, enum.Enum):
        text = str(text.value).replace("_", " ")
    line = f"{time:6.2f} s  {text}"
    height = image.shape[0]
    strip = image[-max(1, height // 15) :]
    strip[:] = strip // 3  # keeps the text legible before any background
    cv2.putText(
        image,
        line,
        (height // 40, height - height // 50),
        cv2.FONT_HERSHEY_SIMPLEX,
        height / 700,
        (255, 255, 255),
        1,
        cv2.LINE_AA,
    )
