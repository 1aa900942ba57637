import subprocess
import sys
from pathlib import Path

from drake_srg.common.installing import LIBRARIES

ROOT = Path(__file__).parents[2]


def script():
    tool = ROOT / "tools" / "dockerfile_script.py"
    command = [sys.executable, str(tool)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_commands_come_in_order_and_comments_do_not():
    words = [line.split()[0] for line in script().splitlines()]
    assert words == ["apt-get", "python3", "export", "drake-srg"]


def test_the_container_has_every_library():
    assert set(LIBRARIES.values()) <= set(script().splitlines()[0].split())


def test_a_shell_understands_the_script():
    subprocess.run(["sh", "-n"], input=script(), text=True, check=True)
