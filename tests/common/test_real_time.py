"""A companion survives Ctrl-C, and its end is reported."""

import gc
import multiprocessing as mp
import os
import queue
import signal
import subprocess
import sys
import weakref

import pytest
from helpers import HEEDING_CTRL_C

from drake_srg.common.real_time import Companion, real_time_loop


class Cycle:
    def __init__(self):
        self.self = self


def test_what_exists_is_not_looked_at_meanwhile():
    with real_time_loop():
        assert gc.get_freeze_count() > 1000
    assert gc.get_freeze_count() == 0


def test_new_garbage_is_collected_meanwhile():
    with real_time_loop():
        seen = weakref.ref(Cycle())
        gc.collect()
        assert seen() is None


def test_threads_take_turns_faster_meanwhile():
    before = sys.getswitchinterval()
    with real_time_loop():
        assert sys.getswitchinterval() < before
    assert sys.getswitchinterval() == before


def test_an_error_ends_it():
    before = sys.getswitchinterval()
    with pytest.raises(KeyError), real_time_loop():
        raise KeyError
    assert gc.get_freeze_count() == 0
    assert sys.getswitchinterval() == before


def test_a_process_gives_way():
    code = (
        "import os; from drake_srg.common.real_time import lower_priority; "
        "before = os.nice(0); lower_priority(); print(os.nice(0) - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert int(done.stdout) > 0


PROGRAM = """
import queue, time
from drake_srg.common.real_time import Companion

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


def stop(connection):
    connection.send("ready")
    os.kill(os.getpid(), signal.SIGSTOP)


def test_close_ends_a_process_that_does_not_react():
    received, others = queue.Queue(), set(mp.active_children())
    companion = Companion("child", stop, (), received.put, lambda: received.put("end"))
    assert received.get(timeout=60.0) == "ready"
    companion.close()
    assert set(mp.active_children()) == others
    assert received.empty()  # no failure
