import gc
import os
import subprocess
import sys
import warnings

import av
import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource
from pydrake.systems.sensors import CameraConfig

from drake_srg.recording.video import VideoRecorder, View, caption
from drake_srg.types import Mode
from recording.recording_sources import Sweep, image


def make(path, width=64, height=48, text=None, **config):
    builder = DiagramBuilder()
    source = builder.AddSystem(Sweep(width, height))
    recorder = builder.AddSystem(VideoRecorder(path, width, height, **config))
    builder.Connect(source.get_output_port(), recorder.GetInputPort("color_image"))
    if text is not None:
        words = builder.AddSystem(ConstantValueSource(AbstractValue.Make(text)))
        builder.Connect(words.get_output_port(), recorder.GetInputPort("caption"))
    return builder.Build(), recorder, source


def decode(path):
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [
            frame.to_ndarray(format="rgb24") for frame in container.decode(stream)
        ]
        return stream, np.array(frames)


def test_a_video_shows_what_the_camera_saw_in_a_format_for_browsers(tmp_path):
    path = tmp_path / "video.mp4"
    diagram, recorder, source = make(path, frame_rate=10.0)
    with recorder:
        Simulator(diagram).AdvanceTo(3.05)
        assert not path.exists()
    assert recorder.frames == source.evaluations == 30
    stream, frames = decode(path)
    assert stream.codec_context.name == "h264"
    assert stream.codec_context.pix_fmt == "yuv420p"
    assert stream.average_rate == 10
    assert frames.shape == (30, 48, 64, 3)
    # The first image is that of t = 0.1, the last that of t = 3.0: 30 red columns.
    red = (frames[:, 24, :, 0] > 125).sum(axis=1)
    np.testing.assert_allclose(red, 1 + np.arange(30), atol=1)
    content = path.read_bytes()
    assert 0 < content.find(b"moov") < content.find(b"mdat")
    assert list(tmp_path.iterdir()) == [path]


def test_equal_runs_give_equal_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        diagram, recorder, _ = make(tmp_path / name, 160, 120, Mode.LIFT)
        with recorder:
            Simulator(diagram).AdvanceTo(1.0)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_bytes_do_not_depend_on_what_memory_held_before(tmp_path):
    code = (
        "import sys, numpy as np, pathlib\n"
        "from drake_srg.recording.video import VideoFile\n"
        "y, x = np.mgrid[:144, :192]\n"
        "file = VideoFile(pathlib.Path(sys.argv[1]), 192, 144, 20.0)\n"
        "for k in range(40):\n"
        "    image = np.stack([3 * x + 5 * k, y // 8 * 40, x // 8 * 40, 0 * x], 2)\n"
        "    image[(x - 96 - k) ** 2 + (y - 72) ** 2 < 1300] = (200, 30, 30, 255)\n"
        "    file.add(image.astype(np.uint8), k / 20)\n"
        "file.close()\n"
    )
    films = []
    for byte in ("1", "255"):
        path = tmp_path / f"{byte}.mp4"
        # glibc fills fresh memory with this byte.
        environment = {**os.environ, "MALLOC_PERTURB_": byte}
        command = [sys.executable, "-c", code, str(path)]
        subprocess.run(command, env=environment, check=True)
        films.append(path.read_bytes())
    assert films[0] == films[1]


def test_odd_sizes_lose_their_last_row_and_column(tmp_path):
    diagram, recorder, _ = make(tmp_path / "video.mp4", 65, 49)
    with recorder:
        Simulator(diagram).AdvanceTo(0.2)
    assert decode(tmp_path / "video.mp4")[1].shape[1:] == (48, 64, 3)


def test_the_caption_is_along_the_lower_edge(tmp_path):
    frames = {}
    for text in (None, Mode.CLOSE):
        diagram, recorder, _ = make(tmp_path / "v.mp4", 320, 240, text)
        with recorder:
            Simulator(diagram).AdvanceTo(0.1)
        frames[text] = decode(tmp_path / "v.mp4")[1][0].astype(float)
    difference = np.abs(frames[None] - frames[Mode.CLOSE]).max(axis=(1, 2))
    assert difference[230:].max() > 100
    assert difference[:215].max() < 20


def test_captions_show_enums_and_strings_alike():
    pictures = [np.full((240, 320, 3), 90, np.uint8) for _ in range(3)]
    for picture, text in zip(pictures, (Mode.LIFT, "lift", "place"), strict=True):
        caption(picture, 1.5, text)
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[1], pictures[2])


def camera_view(**kwargs):
    """Return the view of a camera at 1 m above the origin that looks down."""
    config = CameraConfig(width=640, height=360, fps=8.0)
    X_WB = RigidTransform(RollPitchYaw(np.pi, 0.0, -np.pi / 2), [0.0, 0.0, 1.0])
    return View(config.MakeCameras()[0].core(), X_WB, **kwargs)


def test_names_stand_beside_what_the_camera_sees():
    view = camera_view(kinds={"clutter_1": "mug"})
    poses = {
        "soup_can": RigidTransform([0.0, 0.0, 0.0]),
        "clutter_1": RigidTransform([0.1, 0.0, 0.0]),
        "behind": RigidTransform([0.0, 0.0, 1.5]),
        "far_left": RigidTransform([0.0, 5.0, 0.0]),
    }
    names = dict(view.names(poses))
    assert set(names) == {"soup can", "mug"}
    focal = view.core.intrinsics().focal_x()
    # The image's x is the world's -y, its y the world's -x; 6 cm beside the origin.
    np.testing.assert_allclose(names["soup can"], [320 + 0.06 * focal, 180], atol=1)
    np.testing.assert_allclose(
        names["mug"], [320 + 0.06 * focal, 180 - 0.1 * focal], atol=1
    )


def test_names_of_neighbours_do_not_overlap():
    poses = {
        name: RigidTransform([0.001 * i, 0.0, 0.0]) for i, name in enumerate("abc")
    }
    rows = sorted(y for _, (_, y) in camera_view().names(poses))
    assert np.diff(rows).min() >= 10


def test_pictures_have_names_an_inset_and_end_with_the_verdict(tmp_path):
    path = tmp_path / "video.mp4"
    view, builder = camera_view(), DiagramBuilder()
    recorder = builder.AddSystem(
        VideoRecorder(path, 640, 360, frame_rate=10.0, view=view)
    )
    poses = {"can": RigidTransform()}
    for name, value in (
        ("color_image", image((90, 90, 90, 255), 640, 360)),
        ("inset", image((0, 0, 200, 255), 100, 80)),
        ("object_poses", poses),
    ):
        source = builder.AddSystem(ConstantValueSource(AbstractValue.Make(value)))
        builder.Connect(source.get_output_port(), recorder.GetInputPort(name))
    with recorder:
        Simulator(builder.Build()).AdvanceTo(0.2)
        recorder.judge(True, "success, 1 attempt")
    frames = decode(path)[1].astype(float)
    assert len(frames) == 2 + 15  # 1.5 s of the verdict
    (_, (x, y)), *_ = view.names(poses)
    plain = np.abs(frames[:, :, 100:] - 90.0)
    assert plain[0, y - 10 : y, x - 100 : x - 80].max() > 60  # the name
    assert plain[0, y + 20 :].max() < 12
    assert frames[0, :70, :90, 2].min() > 150  # the inset
    assert (frames[-1, 336:] < 45).any()  # the strip of the verdict
    assert (frames[-1, 336:, :, 1] > 150).any()  # its letters
    assert (frames[-1, 300:336] > 45).all()  # it hides nothing of the scene


def test_no_frames_leave_no_file_and_closing_twice_is_fine(tmp_path):
    diagram, recorder, _ = make(tmp_path / "video.mp4")
    Simulator(diagram).AdvanceTo(0.01)
    recorder.close()
    recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_a_closed_recorder_says_so(tmp_path):
    diagram, recorder, _ = make(tmp_path / "video.mp4")
    recorder.close()
    with pytest.raises(RuntimeError, match=r"video\.mp4: the recorder is closed"):
        Simulator(diagram).AdvanceTo(0.1)


def test_an_image_of_another_size_is_an_error_with_both_sizes(tmp_path):
    with VideoRecorder(tmp_path / "video.mp4", 64, 48) as recorder:
        context = recorder.CreateDefaultContext()
        recorder.GetInputPort("color_image").FixValue(context, image((0, 0, 0, 0), 32))
        with pytest.raises(
            ValueError, match=r"64x48 pixels like video\.mp4, got 32x48"
        ):
            Simulator(recorder, context).AdvanceTo(0.1)


@pytest.mark.parametrize("wrong", [{"width": 1}, {"frame_rate": 0.0}], ids=str)
def test_errors_name_the_bad_argument(tmp_path, wrong):
    [(name, value)] = wrong.items()
    with pytest.raises(
        ValueError, match=f"VideoRecorder: .* must .* got .*{name}={value}"
    ):
        VideoRecorder(**{"path": tmp_path / "v.mp4", "width": 64, "height": 48} | wrong)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_a_recording_up_to_an_error_is_kept(tmp_path, error):
    diagram, recorder, _ = make(tmp_path / "video.mp4")
    with pytest.raises(error), recorder:
        Simulator(diagram).AdvanceTo(0.2)
        raise error
    _, frames = decode(tmp_path / "video.mp4")
    assert len(frames) == 4
    assert list(tmp_path.iterdir()) == [tmp_path / "video.mp4"]


def test_an_error_before_the_first_image_leaves_nothing(tmp_path):
    _, recorder, _ = make(tmp_path / "video.mp4")
    with pytest.raises(ZeroDivisionError), recorder:
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_a_recorder_that_nobody_closes_completes_its_file_and_warns(tmp_path):
    path = tmp_path / "video.mp4"

    def run():
        diagram, _, _ = make(path, frame_rate=10.0)
        Simulator(diagram).AdvanceTo(1.05)

    with pytest.warns(RuntimeWarning, match=r"video.mp4: completed only now.*`with"):
        run()
        gc.collect()
    assert len(decode(path)[1]) == 10


def test_a_recorder_that_recorded_nothing_ends_silently(tmp_path):
    def run():
        make(tmp_path / "video.mp4")

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run()
        gc.collect()
    assert list(tmp_path.iterdir()) == []


def test_drakes_strings_can_be_a_caption(tmp_path):
    path, text = tmp_path / "video.mp4", AbstractValue.Make("")
    diagram, recorder, _ = make(path, text="words", caption=text)
    with recorder:
        Simulator(diagram).AdvanceTo(0.1)
    assert len(decode(path)[1]) == 2
