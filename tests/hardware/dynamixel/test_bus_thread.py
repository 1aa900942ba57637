"""The thread, at emulated servos behind a socket."""

import contextlib
import threading

import numpy as np
import pytest
from bridges.waiting import wait_until

from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.dynamixel.bridge import ServoBridge
from drake_srg.bridges.dynamixel.mechanisms import Arm
from drake_srg.hardware.dynamixel.bus_thread import BusThread
from drake_srg.hardware.dynamixel.line import open_line
from drake_srg.hardware.dynamixel.servo_bus import ServoBus
from drake_srg.hardware.dynamixel.servo_group import GroupConfig, ServoGroup

POSITION = "arm.position_desired"


class Served:
    """Two joints behind a socket, and a thread that drives them."""

    def __init__(self, stack):
        self.inbox = CommandInbox([], Warnings(print))
        ends = np.full(2, 3.0)
        self.bridge = ServoBridge(self.inbox, "tcp:0", [Arm(-ends, ends, ends)])
        stack.callback(self.bridge.close)
        self.told, self.reports = [], []
        warnings = Warnings(self.told.append)
        self.thread = BusThread(self.open, 0.001, warnings)
        config = GroupConfig(ids=[1, 2])
        self.group = ServoGroup(config, self.reports.append, warnings)
        stack.callback(self.thread.remove, self.group)

    def open(self):
        # Patient, because the machine may be busy.
        return ServoBus(open_line(f"tcp:{self.bridge.address}", 57600), timeout=20.0)


@pytest.fixture
def served():
    with contextlib.ExitStack() as stack:
        yield Served(stack)


def test_a_thread_reads_and_commands_until_it_ends(served):
    before = threading.active_count()
    served.thread.add(served.group)
    assert wait_until(lambda: len(served.reports) > 3)
    served.group.goals = {1: 2148, 2: 1948}
    commanded = {}

    def arrived():
        commanded.update(served.inbox.take())
        q = commanded.get(POSITION, np.zeros(2))
        return np.allclose(q, 100 / 4096 * 2 * np.pi * np.array([1, -1]))

    assert wait_until(arrived)
    served.thread.remove(served.group)
    assert served.thread.closed
    assert threading.active_count() == before
    assert served.told == []


def test_a_lost_bus_is_told_and_found_again(served):
    served.thread.add(served.group)
    assert wait_until(lambda: served.reports)
    address = served.bridge.address
    served.bridge.close()
    assert wait_until(lambda: served.told)
    ends = np.full(2, 3.0)
    with contextlib.closing(
        ServoBridge(served.inbox, f"tcp:{address}", [Arm(-ends, ends, ends)])
    ):
        known = len(served.reports)
        assert wait_until(lambda: len(served.reports) > known)
        served.thread.remove(served.group)
    assert "servo bus: " in served.told[0]
