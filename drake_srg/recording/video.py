"""Records a camera as an H.264 video."""

from __future__ import annotations

from pathlib import Path

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.recording.output import OutputFile, Recorder
from drake_srg.recording.video_file import VideoFile


class VideoRecorder(Recorder):
    """Writes a camera's images into an MP4 file that plays in any browser.

    .. pydrake_system::

        name: VideoRecorder
        input_ports:
        - color_image
        - caption (optional)

    `color_image` is an ImageRgba8U. It is sampled every 1 / `frame_rate` of simulated
    time, first after one such period, so video time is simulated time minus one period.
    If `caption` is connected, every frame shows the time and its value: a string, or an
    enum such as `Mode`, shown by its value.

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
    ):
        super().__init__()
        self._output = OutputFile(path)
        try:
            self._file = VideoFile(
                self._output.path, width, height, frame_rate, quality
            )
        except BaseException:
            self._output.discard()
            raise
        self._image = self.DeclareAbstractInputPort(
            name="color_image", model_value=AbstractValue.Make(ImageRgba8U())
        )
        self._caption = self.DeclareAbstractInputPort(
            name="caption", model_value=AbstractValue.Make(object())
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
