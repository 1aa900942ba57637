"""Ctrl-C reaches the parent alone."""

import os
import signal
import subprocess
import sys

from helpers import HEEDING_CTRL_C

PROGRAM = """
import multiprocessing as mp, signal, time
from drake_srg.common.processes import start_shielded

def child(connection):
    connection.send("ready")
    connection.send(connection.recv())

if __name__ == "__main__":
    context = mp.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=child, args=(theirs,), daemon=True)
    start_shielded(process)
    theirs.close()
    try:
        print(ours.recv(), flush=True)
        time.sleep(60.0)
    except KeyboardInterrupt:
        ours.send("alive")
        print(ours.recv(), flush=True)
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
    assert (told, errors) == ("alive\n", "")
