"""`drake-srg serve`, as somebody types it."""

import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from bridges.conftest import wait_until
from rosbags.rosbag2 import Reader

from drake_srg.cli import main as cli

COMMAND = (sys.executable, "-m", "drake_srg", "serve")


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["kitchen"], "needs at least one of --ros1, --ros2 and --servo"),
        (["kitten", "--ros2"], "scenario 'kitten' is unknown"),
        (["kitchen", "--ros2", "--rate", "-1"], "--rate: -1: must be a number from 0"),
        (["kitchen", "--ros2", "--rate", "fast"], "--rate: fast: must be a number"),
        (["kitchen", "--ros2", "--domain", "233"], "233"),
        (["kitchen", "--ros1", "--master", "roscore"], "roscore"),
        (["kitchen", "--servo", "tcp:0"], "!SrgTendonDriver"),
        (["gripper_bench", "--servo", "rs485"], "rs485"),
        (["kitchen", "--ros2", "--name", "my node"], "--name my node: must be letters"),
        (["gripper_bench", "--servo", "tcp:99999"], "99999"),
    ],
)
def test_bad_input_is_one_line_that_helps(arguments, words, capsys):
    try:
        code = cli.main(["serve", *arguments, "--no-record"])
    except SystemExit as end:
        code = end.code
    assert code == cli.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("drake-srg: ") and error.count("\n") == 1
    assert words in error


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_it_stops_cleanly_with_its_recording_complete(tmp_path, number):
    process = subprocess.Popen(
        [*COMMAND, "gripper_bench", "--servo", "tcp:0", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    first = process.stdout.readline()
    assert re.match(r"gripper_bench: servo at tcp:127\.0\.0\.1:\d+; ", first)
    process.send_signal(number)
    rest, errors = process.communicate(timeout=60)
    assert process.returncode == cli.SUCCESS
    assert errors == ""
    summary, path = rest.splitlines()
    assert re.fullmatch(r"served [\d.]+ s in [\d.]+ s, 0 commands", summary)
    assert path == str(tmp_path / "recording.mcap")
    with Reader(path):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["recording.mcap"]


def test_a_port_that_is_taken_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        arguments = ["gripper_bench", "--servo", f"tcp:{port}", "--out", str(tmp_path)]
        ended = subprocess.run(
            [*COMMAND, *arguments],
            check=False,
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert ended.returncode == cli.BAD_INPUT
    assert ended.stderr.count("\n") == 1 and "in use" in ended.stderr
    assert not list(tmp_path.iterdir())


def has_loaded_drake(process):
    return "libdrake" in Path(f"/proc/{process.pid}/maps").read_text()


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
def test_asked_to_stop_while_it_starts_it_does_so_quietly(delay):
    arguments = ["gripper_bench", "--servo", "tcp:0", "--no-record"]
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    # Until then it is Python that starts, and has words of its own.
    assert wait_until(lambda: has_loaded_drake(process))
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(delay)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert "Traceback" not in errors
    assert process.returncode in (cli.SUCCESS, cli.BAD_INPUT, -signal.SIGINT)
