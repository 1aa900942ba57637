import gc
import subprocess
import sys
import weakref

import pytest

from drake_srg.common.real_time import real_time_loop


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
