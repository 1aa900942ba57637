import asyncio
import threading

import pytest

from drake_srg.bridges.io_thread import IoThread


@pytest.fixture
def io():
    thread = IoThread("test")
    yield thread
    thread.stop()


async def _name():
    return threading.current_thread().name


def test_coroutines_run_in_the_named_thread(io):
    assert io.call(_name()) == "test"


def test_a_posted_function_runs(io):
    done = threading.Event()
    io.post(done.set)
    assert done.wait(20.0)


def test_a_call_that_times_out_leaves_the_thread_running(io):
    with pytest.raises(TimeoutError):
        io.call(asyncio.sleep(3600.0), timeout=0.05)
    assert io.call(_name()) == "test"


def test_stop_cancels_running_tasks_and_may_be_repeated(io):
    started, ended = threading.Event(), threading.Event()

    async def forever():
        started.set()
        try:
            await asyncio.sleep(3600.0)
        finally:
            ended.set()

    io.post(io.loop.create_task, forever())
    assert started.wait(20.0)
    io.stop()
    io.stop()
    assert ended.is_set()
