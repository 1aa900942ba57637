"""A companion outlives Ctrl-C, and its end is told."""

import os
import signal
import subprocess
import sys

from helpers import HEEDING_CTRL_C

PROGRAM = """
import queue, time
from drake_srg.common.processes import Companion

def child(connection):
    connection.send("ready")
    connection.send(connection.recv())

if __name__ == "__main__":
    received = queue.Queue()
    companion = Companion("child", child, (), received.put, lambda: received.put("end"))
    try:
        print(received.get(), flush=True)
        time.sleep(60.0)
    except KeyboardInterrupt:
        companion.send("alive")
        print(received.get(), received.get(), flush=True)
    companion.send("nobody hears this")
    companion.close()
"""


def test_ctrl_c_reaches_the_parent_alone(tmp_path):
    # In an interpreter of its own, because its first process differs from later ones.
    file = tmp_path / "program.py"
    file.write_text(PROGRAM)
    with subprocess.Popen(
        [*HEEDING_CTRL_C, sys.executable, str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as parent:
        assert parent.stdout.readline() == "ready\n"
        os.killpg(parent.pid, signal.SIGINT)  # as a terminal sends it, to all
        told, errors = parent.communicate(timeout=60.0)
    assert (told, errors) == ("alive end\n", "")
