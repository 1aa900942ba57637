"""`drake-srg serve` as a command."""

import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import NEEDS_DDS
from robot.serve.waiting import wait_until
from rosbags.rosbag2 import Reader

from drake_srg.cli import main as cli

pytestmark = pytest.mark.slow

COMMAND = (sys.executable, "-m", "drake_srg", "serve")


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["kitchen"], "needs at least one of --ros1, --ros2, --servo and --dex1"),
        (["kitten", "--ros2"], "unknown scenario 'kitten'"),
        (["kitchen", "--ros2", "--rate", "-1"], "--rate: must be a number of at least"),
        (["kitchen", "--ros2", "--rate", "fast"], "at least 0, got fast"),
        (["kitchen", "--ros2", "--camera-period", "0"], "must be a positive number"),
        pytest.param(
            ["kitchen", "--ros2", "--domain", "233"],
            "must be 0 to 232, got 233",
            marks=NEEDS_DDS,
        ),
        (["kitchen", "--ros1", "--master", "roscore"], "got 'roscore'"),
        (["gripper_bench", "--servo", "rs485"], "got 'rs485'"),
        (["gripper_bench", "--servo", "pty", "--protocol", "2.0"], "'2.0'"),
        (["kitchen", "--dex1", "middle"], "without repeats; got middle"),
        (["kitchen", "--dex1", "left,left"], "one or more of left"),
        (["kitchen", "--dex1", "left", "--ros2"], "cannot go with --ros2 or --servo"),
        pytest.param(["kitchen", "--dex1", "left"], "wire motor", marks=NEEDS_DDS),
        pytest.param(
            ["gripper_bench", "--dex1", "left", "--domain", "233"],
            "must be 0 to 232, got 233",
            marks=NEEDS_DDS,
        ),
    ],
)
def test_bad_input_is_reported_on_one_line(arguments, words, capsys):
    try:
        code = cli.main(["serve", *arguments, "--no-record"])
    except SystemExit as end:
        code = end.code
    assert code == cli.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("drake-srg: ") and error.count("\n") == 1
    assert words in error


def test_missing_cyclonedds_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    for name in [name for name in sys.modules if "serve.dex1" in name]:
        monkeypatch.delitem(sys.modules, name)
    code = cli.main(["serve", "gripper_bench", "--dex1", "left", "--no-record"])
    assert code == cli.BAD_INPUT
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "need 'cyclonedds', which is not installed. Run: " in error


def test_a_signal_stops_it_with_a_complete_recording(tmp_path):
    process = subprocess.Popen(
        [*COMMAND, "gripper_bench", "--servo", "tcp:0", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    first = process.stdout.readline()
    assert re.match(r"gripper_bench: servo at tcp:127\.0\.0\.1:\d+; ", first)
    process.send_signal(signal.SIGTERM)
    rest, errors = process.communicate(timeout=60)
    assert process.returncode == cli.SUCCESS
    assert errors == ""
    summary, path, *pages = rest.splitlines()
    assert re.fullmatch(r"served [\d.]+ s in [\d.]+ s, 0 commands", summary)
    assert path == str(tmp_path / "recording.mcap")
    with Reader(path):
        pass
    # The signal may come before the first step.
    assert pages in ([], [str(tmp_path / "replay.html")])


def test_a_port_in_use_is_an_error_of_one_line(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        arguments = ["gripper_bench", "--servo", f"tcp:{port}", "--out", str(tmp_path)]
        assert cli.main(["serve", *arguments]) == cli.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert "in use" in line
    assert not list(tmp_path.iterdir())


def has_loaded_drake(process):
    return "libdrake" in Path(f"/proc/{process.pid}/maps").read_text()


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
def test_a_signal_during_the_start_stops_it_quietly(delay):
    arguments = ["gripper_bench", "--servo", "tcp:0", "--no-record"]
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    # Before that, Python itself handles the signal, with a traceback.
    assert wait_until(lambda: has_loaded_drake(process))
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(delay)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert "Traceback" not in errors
    assert process.returncode in (cli.SUCCESS, cli.BAD_INPUT, -signal.SIGINT)
