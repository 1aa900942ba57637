"""What `make_dataset` and the command say of bad input, and leave behind: nothing."""

import pytest

from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.dataset import files, video
from drake_srg.sweeps.dataset.make import make_dataset
from drake_srg.sweeps.dataset.recording import read_images, read_signals
from drake_srg.sweeps.rows import all_rows_path, read_rows, row_path, write_rows
from sweeps.dataset import lerobot_format as lerobot
from sweeps.dataset.recorded_sweep import write_sweep, write_trial


def complaint(sweep, out=None, **options):
    """What is said of bad input, in one line; nothing is left behind."""
    before = sorted(sweep.rglob("*"))
    with pytest.raises(ScenarioError) as info:
        make_dataset(sweep, out, **options)
    assert sorted(sweep.rglob("*")) == before
    assert "\n" not in str(info.value)
    return str(info.value)


def test_no_sweep_and_no_recordings(tmp_path):
    assert "no sweep" in complaint(tmp_path)
    sweep = write_sweep(tmp_path)
    assert "no recordings; make the sweep with --record all" in complaint(sweep)
    write_trial(sweep, 0, 0.2, failure="blocked")
    assert "--only-success" in complaint(sweep, only_success=True)


def test_recordings_of_no_trial_that_came_to_its_end(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2, failure="error")
    (sweep / "recordings/000000/metrics.json").unlink()
    assert "to their end (1 that ended in an error)" in complaint(sweep)
    row_path(sweep, 0).unlink()
    assert "to their end (1 not over)" in complaint(sweep)


def test_rows_that_cannot_be_read(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2)
    row_path(sweep, 0).write_bytes(b"PAR1")
    assert "000000.parquet: cannot be read" in complaint(sweep)


def test_nothing_is_left_out_of_a_sweep_that_is_over(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2)
    write_rows(all_rows_path(sweep), read_rows(sweep))
    row_path(sweep, 0).unlink()
    made = make_dataset(sweep)
    assert (made.episodes, made.left_out) == (1, "")


def test_recording_without_images(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2, cameras={})
    said = complaint(sweep)
    assert "000000/recording.mcap: has no images" in said
    assert "recording.bag_cameras" in said


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"cameras": {"ceiling": (160, 130), "side": (131, 129)}}, "ceiling 160x130"),
        ({"cameras": {"ceiling": (160, 128)}}, "000005 has ceiling 160x128 at 8 Hz"),
        ({"image_period": 0.0625}, "at 16 Hz"),
    ],
)
def test_recordings_that_are_not_alike(tmp_path, change, what):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.3)
    write_trial(sweep, 5, 0.3, **change)
    said = complaint(sweep)
    assert what in said and "recorded alike" in said


@pytest.mark.parametrize("fps", [0, -8, 3, 16])
def test_frames_per_second_that_do_not_fit(sweep, fps):
    assert complaint(sweep, fps=fps).endswith("8 Hz; allowed for --fps: 1, 2, 4, 8")


def test_images_at_no_whole_rate(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.5, image_period=0.4)
    assert "images come at 2.5 Hz" in complaint(sweep)
    write_trial(sweep, 0, 0.5, image_period=2 / 15)
    assert "allowed" not in complaint(sweep, fps=7)
    assert "record with a recording.bag_camera_period" in complaint(sweep)


def test_output_that_exists(sweep, tmp_path):
    assert complaint(sweep, tmp_path).startswith(f"-o {tmp_path}: exists")


@pytest.mark.parametrize("length", [0, 100, 0.5, 0.999])
def test_broken_recording(sweep, tmp_path, length):
    whole = (sweep / "recordings/000003/recording.mcap").read_bytes()
    broken = write_sweep(tmp_path)
    write_trial(broken, 0, 0.2)
    path = broken / "recordings/000000/recording.mcap"
    path.write_bytes(whole[: int(length * len(whole) if length < 1 else length)])
    assert f"{path}: cannot be read" in complaint(broken)


def test_flipped_bits_in_a_recording(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2, cameras={"ceiling": (16, 12)})
    path = sweep / "recordings/000000/recording.mcap"
    whole = path.read_bytes()
    told = 0
    for place in range(0, len(whole), len(whole) // 100):
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
    assert told > 10


@pytest.mark.parametrize("text", ["", "{}", "[]"])
def test_broken_metrics(tmp_path, text):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.2)
    (sweep / "recordings/000000/metrics.json").write_text(text)
    assert "000000/metrics.json: is not a trial's" in complaint(sweep)


def raise_(error):
    """A method that does nothing else."""

    def method(self, *arguments):
        raise error

    return method


def test_nothing_half_written_stays(sweep, tmp_path, monkeypatch):
    whole = video.VideoFiles.append
    calls = []

    def append(self, episode):
        calls.append(self)
        if len(calls) > 3:  # the second camera of the second episode
            raise KeyboardInterrupt
        return whole(self, episode)

    monkeypatch.setattr(video.VideoFiles, "append", append)
    with pytest.raises(KeyboardInterrupt):
        make_dataset(sweep, tmp_path / "made")
    assert list(tmp_path.iterdir()) == []


def command(*arguments):
    return main(["dataset", *map(str, arguments)])


def test_command(sweep, tmp_path, capsys):
    made = tmp_path / "made"
    assert command(sweep, "-o", made, "--fps", "4", "--only-success") == 0
    said = capsys.readouterr().out
    assert said.splitlines() == [
        "2 episodes (2 successful), 9 frames at 4 per second",
        "recorded trials left out: 2 that ended in an error, 1 not over",
        str(made),
    ]
    lerobot.check(made)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--fps", "3"], "--fps 3: images come at 8 Hz; allowed for --fps: 1, 2, 4, 8"),
        (["-o", "/proc/made"], "-o /proc/made: cannot be written: No such file or dir"),
        (["--fps", "fast"], "--fps"),
    ],
)
def test_command_says_what_is_wrong(sweep, tmp_path, capsys, arguments, said):
    arguments = [sweep, "-o", tmp_path / "made", *arguments]
    try:
        code = command(*arguments)
    except SystemExit as error:  # argparse's
        code = error.code
    assert code == 2
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1 and said in complaint
    assert list(tmp_path.iterdir()) == []


def test_command_on_a_full_disk(sweep, tmp_path, monkeypatch, capsys):
    full = OSError(28, "Error writing bytes. Detail: [errno 28] No space left")
    monkeypatch.setattr(files.ParquetFiles, "append", raise_(full))
    assert command(sweep, "-o", tmp_path / "made") == 2
    assert capsys.readouterr().err.endswith("written: No space left on device\n")
    assert list(tmp_path.iterdir()) == []


def test_command_is_interrupted(sweep, tmp_path, monkeypatch, capsys):
    stop = raise_(KeyboardInterrupt())
    monkeypatch.setattr(files.ParquetFiles, "append", stop)
    assert command(sweep, "-o", tmp_path / "made") == 2
    assert capsys.readouterr().err == "drake-srg: stopped\n"
    assert list(tmp_path.iterdir()) == []
