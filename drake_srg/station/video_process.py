"""Videos that a separate process renders and encodes during the simulation.

Rendering in software takes longer than simulating. So the simulation only sends the
plant's states to another process, which builds the same cameras and makes the video:
`python -m drake_srg.station.video_process`.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import fcntl
import os
import pickle
import select
import signal
import subprocess
import sys
import time as wall
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.framework import Context

import drake_srg
from drake_srg.common.exceptions import one_line
from drake_srg.common.real_time import lower_priority
from drake_srg.recording.output import require
from drake_srg.recording.video import CaptionedRecorder, VideoFile, View
from drake_srg.scenario import LocalizerConfig, Scenario
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station.cameras import MakeRemoteCameras
from drake_srg.types import mode_words

# Size of the pipe for states that wait to be rendered, about a minute's [bytes].
_PIPE = 1 << 20
_PATIENCE = 120.0  # s; a frame takes seconds at worst
_VERDICT = 2  # greatest length of the last message; messages with frames are longer
# Sign of life that precedes the answer, and the least time between two of them [s].
_SIGN, _SIGN_PERIOD = b"\0", 1.0


def can_render_apart(scenario: Scenario) -> bool:
    """Return whether a separate process can render a scenario's video.

    It cannot render soft objects, because a plant's state does not hold their shape.
    """
    soft = any(config.soft for config in scenario.objects.values())
    return bool(scenario.recording.video_camera) and not soft


class VideoProcess:
    """A process that renders and encodes `recording.video_camera` of a scenario.

    Use it as a context manager: on exit the process ends, whatever it was doing.

    Args:
        scenario: The scenario; `can_render_apart` must hold.
        tell: Called with a line for the user if the process fails.
        patience: Time without a sign of life after which a process with work to do is
            ended [s, wall clock].

    Raises:
        ImportError: If PyAV is missing.
        OSError: If no process can be started.
    """

    def __init__(
        self,
        scenario: Scenario,
        tell: Callable[[str], None],
        patience: float = _PATIENCE,
    ):
        require("av")
        self._tell, self._patience, self._hung = tell, patience, False
        package = str(Path(drake_srg.__file__).parents[1])
        paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,  # Ctrl-C in a terminal is for the simulation
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin = self._process.stdin.fileno()
        self._stdout = self._process.stdout.fileno()
        os.set_blocking(self._stdin, False)  # or a hung process would stop us
        with contextlib.suppress(OSError):  # the system's limit is lower
            fcntl.fcntl(self._stdin, fcntl.F_SETPIPE_SZ, _PIPE)
        # Drake's schema objects do not pickle, but their YAML does. The process needs
        # models, the cameras that are filmed, and the camera from which a card may hide
        # an object. It may not know the gripper's driver, which may be the user's own.
        hidden_from = scenario.localizer.cameras[:1]
        filmed = scenario.recording.video_camera, scenario.recording.inset_camera
        names = {*filter(None, filmed), *hidden_from}
        seen = dc.replace(
            scenario,
            gripper=None,
            arms={n: dc.replace(a, gripper=None) for n, a in scenario.arms.items()},
            localizer=LocalizerConfig(cameras=hidden_from),
            cameras={name: scenario.cameras[name] for name in sorted(names)},
            recording=dc.replace(scenario.recording, bag_cameras=[]),
        )
        self.send(yaml_dump_typed(seen))

    def __enter__(self) -> VideoProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()

    def send(self, *message: Any) -> None:
        """Send a message: the scenario's YAML, then the path, then frames.

        A frame consists of its time [s], its caption, the plant's state and the names
        to write into it. Messages to a process that has ended, or hangs, are lost;
        `finish` reports this.
        """
        rest = pickle.dumps(message)
        with contextlib.suppress(OSError):
            while rest and self._ready(self._stdin, select.POLLOUT):
                rest = rest[os.write(self._stdin, rest) :]

    def finish(self, verdict: tuple[bool, str] | None = None) -> int:
        """Wait until the video is complete, and return its number of frames.

        Args:
            verdict: Verdict on the last frame, see `VideoFile.hold`.

        Returns:
            The number; 0 if the process failed, and `tell` was called with the reason.

        Raises:
            OSError: If the file could not be written.
        """
        self.send(*(verdict or ()))
        assert self._process.stdin is not None
        self._process.stdin.close()
        answer = b""
        while self._ready(self._stdout, select.POLLIN):
            if not (more := os.read(self._stdout, 1 << 16)):
                break
            answer += more
        answer = answer.lstrip(_SIGN)
        if not answer:
            answer = pickle.dumps((0, 0, f"the process that renders it {self._end()}"))
        frames, number, reason = pickle.loads(answer)
        if number:
            raise OSError(number, os.strerror(number))
        if reason:
            self._tell(f"no video: {reason}")
        return int(frames)

    def _ready(self, pipe: int, event: int) -> bool:
        """Wait until a pipe is ready; end the process if it hangs instead."""
        poll = select.poll()
        poll.register(pipe, event)
        if poll.poll(1e3 * self._patience):
            return True
        self._hung = True
        self._process.kill()
        return False

    def _end(self) -> str:
        """Describe how the process ended without an answer."""
        code = self._process.wait()
        if self._hung:
            return f"hung (no sign of life for {self._patience:g} s)"
        ended = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"died ({ended})"


class RemoteVideoRecorder(CaptionedRecorder):
    """Records a camera as an H.264 video in a separate process.

    .. pydrake_system::

        name: RemoteVideoRecorder
        input_ports:
        - plant_state
        - caption
        - object_poses

    It makes the same frames as a `VideoRecorder` at the same camera. `close()` waits
    for them.

    Args:
        process: Renders and encodes the frames.
        path: The .mp4 file.
        state_size: Size of the plant's state.
        frame_rate: Images per simulated second [Hz].
        view: Projection that places objects' names; None: no names.

    Raises:
        OSError: If the file cannot be written.
    """

    def __init__(
        self,
        process: VideoProcess,
        path: Path,
        state_size: int,
        frame_rate: float,
        view: View | None = None,
    ):
        super().__init__()
        self._process = process
        self._begin(path)
        self._state = self.DeclareVectorInputPort("plant_state", state_size)
        self._declare_texts(view, None)
        period = 1.0 / frame_rate
        self.DeclarePeriodicPublishEvent(period, period, self._record)
        process.send(str(self._output.path))

    def _finish(self) -> bool:
        try:
            return self._process.finish(self._verdict) > 0
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error

    def _record(self, context: Context) -> None:
        state = np.array(self._state.Eval(context))
        # The other process does not know the user's own modes.
        words = mode_words(self._caption.Eval(context))
        self._process.send(context.get_time(), words, state, self._names(context))


def main() -> None:
    """Render the frames from standard input until it ends, and answer."""
    lower_priority()
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # whatever libraries print goes to standard error
    frames, number, reason = 0, 0, ""
    last = wall.monotonic()

    def live() -> None:
        nonlocal last
        if wall.monotonic() > last + _SIGN_PERIOD:
            last = wall.monotonic()
            answers.write(_SIGN)

    try:
        frames = _render(live)
    except (EOFError, BrokenPipeError):  # the simulation's process is gone
        return
    except OSError as error:
        number, reason = error.errno or 0, str(error)
    except Exception as error:
        reason = one_line(error)
    with answers, contextlib.suppress(BrokenPipeError):
        pickle.dump((frames, number, reason), answers)


def _render(live: Callable[[], None]) -> int:
    """Make the video, and return its number of frames."""
    (text,) = pickle.load(sys.stdin.buffer)
    scenario = read_typed(Scenario, text)
    name, close = scenario.recording.video_camera, scenario.recording.inset_camera
    cameras = MakeRemoteCameras(scenario)
    context = cameras.CreateDefaultContext()
    state = cameras.GetInputPort("state")
    port = cameras.GetOutputPort(f"camera_{name}.color_image")
    near = cameras.GetOutputPort(f"camera_{close}.color_image") if close else None
    config, fps = scenario.cameras[name], scenario.recording.video_fps
    (path,) = pickle.load(sys.stdin.buffer)
    file = VideoFile(Path(path), config.width, config.height, fps)
    while len(message := pickle.load(sys.stdin.buffer)) > _VERDICT:
        time, words, value, names = message
        context.SetTime(time)
        state.FixValue(context, value)
        inset = None if near is None else near.Eval(context).data
        file.add(port.Eval(context).data, time, words, names, inset)
        live()
    if message:
        file.hold(*message)
    file.close()
    return file.frames


if __name__ == "__main__":
    main()
