import math
import threading

import pytest

from drake_srg.bridges.pacing import Pacer


class Wall:
    """A fake clock, and the stop event whose waits advance it."""

    def __init__(self):
        self.time = 100.0
        self.set = False

    def __call__(self):
        return self.time

    def wait(self, timeout):
        self.time += timeout


def run(wall, rate, steps, work, period=0.005):
    """Pace steps that take `work` [s] each, a number or a function of the step."""
    pacer = Pacer(rate, wall, clock=wall)
    for step in range(1, steps + 1):
        wall.time += work(step) if callable(work) else work
        pacer.wait(step * period)
    return pacer


@pytest.mark.parametrize("rate", [0.1, 1.0, 2.5])
def test_simulated_time_passes_at_the_rate(rate):
    wall = Wall()
    pacer = run(wall, rate, 2000, work=0.0005)
    assert wall.time - 100.0 == pytest.approx(10.0 / rate)
    assert pacer.factor == pytest.approx(rate, rel=0.01)
    assert pacer.lost == 0.0


def test_an_infinite_rate_never_waits():
    wall = Wall()
    pacer = run(wall, math.inf, 2000, work=0.0005)
    assert wall.time - 100.0 == pytest.approx(1.0)
    assert pacer.factor == pytest.approx(10.0, rel=0.01)


def test_a_short_stall_is_caught_up_with():
    wall = Wall()
    pacer = run(wall, 1.0, 2000, work=lambda step: 0.4 if step == 500 else 0.001)
    assert wall.time - 100.0 == pytest.approx(10.0)
    assert pacer.lost == 0.0


def test_a_long_stall_is_given_up():
    wall = Wall()
    pacer = run(wall, 1.0, 2000, work=lambda step: 3.0 if step == 500 else 0.001)
    assert pacer.lost == pytest.approx(3.0 - 0.005)
    assert pacer.too_slow is None
    assert wall.time - 100.0 == pytest.approx(10.0 + pacer.lost)


def test_a_run_that_is_too_slow_tells_its_rate():
    pacer = run(Wall(), 1.0, 2000, work=0.010)
    assert pacer.factor == pytest.approx(0.5, rel=0.01)
    assert pacer.too_slow == pytest.approx(0.5, rel=0.01)


def test_a_run_that_is_slow_only_at_its_start_is_not_too_slow():
    pacer = run(Wall(), 1.0, 4000, work=lambda step: 0.010 if step < 500 else 0.001)
    assert pacer.too_slow is None


def test_a_stop_ends_a_wait():
    stop = threading.Event()
    threading.Timer(0.05, stop.set).start()
    Pacer(1.0, stop).wait(3600.0)  # returns only because of the stop
    assert stop.is_set()
