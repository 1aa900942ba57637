"""Bad input gives `make_dataset` and the command a clear message and no files."""

import numpy as np
import pytest

from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.dataset import format
from drake_srg.sweeps.dataset.make import make_dataset
from drake_srg.sweeps.dataset.recording import read_images, read_signals
from drake_srg.sweeps.rows import all_rows_path, read_rows, row_path, write_rows
from sweeps.dataset import lerobot_format as lerobot
from sweeps.dataset import recorded_sweep
from sweeps.dataset.recorded_sweep import write_sweep, write_trial


def complaint(sweep, out=None, **options):
    """Return the message, in one line, of a data set that fails and leaves nothing."""
    before = sorted(sweep.rglob("*"))
    with pytest.raises(ScenarioError) as info:
        make_dataset(sweep, out, **options)
    assert sorted(sweep.rglob("*")) == before
    assert "\n" not in str(info.value)
    return str(info.value)


def test_a_folder_without_a_sweep_or_without_recordings_is_named(tmp_path):
    assert "no sweep" in complaint(tmp_path)
    sweep = write_sweep(tmp_path)
    assert "contains no recordings; sweep with --record all" in complaint(sweep)
    write_trial(sweep, 0, 0.2, failure="blocked")
    assert "--only-success" in complaint(sweep, only_success=True)


def test_recordings_of_unfinished_trials_alone_are_not_enough(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2, failure="error")
    (sweep / "recordings/000000/metrics.json").unlink()
    assert "no recordings of finished trials (1 that ended in an error)" in complaint(
        sweep
    )
    row_path(sweep, 0).unlink()
    assert "no recordings of finished trials (1 unfinished)" in complaint(sweep)


@pytest.mark.slow
def test_a_finished_sweep_has_nothing_left_out(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2)
    write_rows(all_rows_path(sweep), read_rows(sweep))
    row_path(sweep, 0).unlink()
    made = make_dataset(sweep)
    assert (made.episodes, made.left_out) == (1, "")


def test_a_recording_without_images_is_named(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2, cameras={})
    said = complaint(sweep)
    assert "000000/recording.mcap: contains no images" in said
    assert "recording.bag_cameras" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            {"cameras": {"ceiling": (160, 130), "side": (131, 129)}},
            "got ceiling 160x130",
        ),
        (
            {"cameras": {"ceiling": (160, 128)}},
            "000005: all recordings of a data set must",
        ),
        ({"image_period": 0.0625}, "at 16 Hz"),
        (
            {"located": False},
            "expected ceiling 160x128, side 130x128 at 8 Hz, 4 joints, "
            "3 commands, object pose",
        ),
    ],
)
def test_recordings_with_different_layouts_are_rejected(tmp_path, change, what):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.3)
    write_trial(sweep, 5, 0.3, **change)
    said = complaint(sweep)
    assert what in said and "must have the same layout" in said


@pytest.mark.slow
@pytest.mark.parametrize("fps", [0, -8, 3, 16])
def test_frames_per_second_must_divide_the_image_rate(sweep, fps):
    assert complaint(sweep, fps=fps).endswith("8 Hz; allowed for --fps: 1, 2, 4, 8")


@pytest.mark.slow
def test_a_fractional_image_rate_needs_fps_or_another_recording(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.5, image_period=0.4)
    assert "images are recorded at 2.5 Hz" in complaint(sweep)
    write_trial(sweep, 0, 0.5, image_period=2 / 15)
    assert "allowed" not in complaint(sweep, fps=7)
    assert "record with a recording.bag_camera_period" in complaint(sweep)


def test_an_existing_folder_is_not_overwritten(sweep, tmp_path):
    assert complaint(sweep, tmp_path).startswith(f"-o {tmp_path}: already exists")


@pytest.mark.parametrize("length", [0, 100, 0.5, 0.999])
def test_a_truncated_recording_is_named(sweep, tmp_path, length):
    whole = (sweep / "recordings/000003/recording.mcap").read_bytes()
    broken = write_sweep(tmp_path)
    write_trial(broken, 0, 0.2)
    path = broken / "recordings/000000/recording.mcap"
    path.write_bytes(whole[: int(length * len(whole) if length < 1 else length)])
    assert f"{path}: cannot be read" in complaint(broken)


@pytest.mark.slow
def test_flipped_bits_in_a_recording_are_errors_of_one_line(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2, cameras={"ceiling": (16, 12)})
    path = sweep / "recordings/000000/recording.mcap"
    whole = path.read_bytes()
    told = 0
    for place in range(0, len(whole), len(whole) // 50):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        try:
            layout = read_signals(path).layout
            for camera in layout.cameras:
                list(read_images(path, camera))
        except ScenarioError as error:
            assert "\n" not in str(error)
            told += str(error).startswith(f"{path}: cannot be read: ")
    assert told > 5


@pytest.mark.parametrize("wrong", [1e300, np.nan])
def test_values_that_no_data_set_can_have_are_named(tmp_path, monkeypatch, wrong):
    positions = recorded_sweep.joint_positions
    monkeypatch.setattr(
        recorded_sweep, "joint_positions", lambda t: positions(t) + wrong
    )
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2)
    said = complaint(sweep)
    assert "recording.mcap: joints: values must be finite as 32-bit floats" in said


@pytest.mark.parametrize("text", ["", "{}", "[]"])
def test_broken_metrics_are_named(tmp_path, text):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2)
    (sweep / "recordings/000000/metrics.json").write_text(text)
    assert "000000/metrics.json: invalid content: " in complaint(sweep)


def raise_(error):
    """Return a method that raises an error."""

    def method(self, *arguments):
        raise error

    return method


def test_an_interruption_leaves_nothing(sweep, tmp_path, monkeypatch):
    whole = format.VideoFiles.append
    calls = []

    def append(self, episode):
        calls.append(self)
        if len(calls) > 3:  # the second camera of the second episode
            raise KeyboardInterrupt
        return whole(self, episode)

    monkeypatch.setattr(format.VideoFiles, "append", append)
    with pytest.raises(KeyboardInterrupt):
        make_dataset(sweep, tmp_path / "made")
    assert list(tmp_path.iterdir()) == []


def command(*arguments):
    return main(["dataset", *map(str, arguments)])


@pytest.mark.slow
def test_the_command_prints_what_it_made(sweep, tmp_path, capsys):
    made = tmp_path / "made"
    assert command(sweep, "-o", made, "--fps", "4", "--only-success") == 0
    said = capsys.readouterr().out
    assert said.splitlines() == [
        "2 episodes (2 successful), 9 frames at 4 per second",
        "recorded trials left out: 2 that ended in an error, 1 unfinished",
        str(made),
    ]
    lerobot.check(made)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--fps", "3"], "--fps 3: must divide the image rate, 8 Hz; allowed for"),
        (
            ["-o", "/proc/made"],
            "--out /proc/made: cannot be written: No such file or dir",
        ),
        (["--fps", "fast"], "--fps"),
    ],
)
def test_the_command_reports_errors_in_one_line(
    sweep, tmp_path, capsys, arguments, said
):
    arguments = [sweep, "-o", tmp_path / "made", *arguments]
    try:
        code = command(*arguments)
    except SystemExit as error:  # argparse's
        code = error.code
    assert code == 2
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1 and said in complaint
    assert list(tmp_path.iterdir()) == []


def test_the_command_reports_a_full_disk(sweep, tmp_path, monkeypatch, capsys):
    full = OSError(28, "Error writing bytes. Detail: [errno 28] No space left")
    monkeypatch.setattr(format.ParquetFiles, "append", raise_(full))
    assert command(sweep, "-o", tmp_path / "made") == 2
    assert capsys.readouterr().err.endswith("written: No space left on device\n")
    assert list(tmp_path.iterdir()) == []
