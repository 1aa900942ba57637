import subprocess
import sys
from pathlib import Path

import pytest

from robot.serve.dynamixel.fake_station import FakeStation

EXAMPLE = Path(__file__).parents[4] / "examples" / "servo_client.py"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [([], "usage: servo_client.py DEVICE"), (["none"], "none: No such file or dir")],
)
def test_a_missing_device_is_one_line(arguments, message):
    command = [sys.executable, str(EXAMPLE), *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    (line,) = ended.stderr.splitlines()
    assert line.startswith(message)


@pytest.mark.slow
def test_the_example_finds_the_fingers_meeting():
    with FakeStation("pty", protocol=2) as station:
        command = [sys.executable, str(EXAMPLE), station.bridge.address]
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=60, check=True
        )
    meeting, opened, closed, *samples = ended.stdout.splitlines()
    assert meeting == "the fingers meet at 1473 counts"
    assert opened == "asked for 50 %, stopped at 50 %"
    assert closed == "asked for -10 %, stopped at 0 %"
    # 15 % of the PWM of 4.1 A.
    assert samples == ["  -0.61 A, 30 degrees Celsius, errors 0"] * 3
    assert station.warnings == []
