import io
import os
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from helpers import needs_pty

from bridges.waiting import wait_until
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.connecting import BridgeOptions
from drake_srg.bridges.keyboard import KeyboardBridge, own_terminal
from drake_srg.bridges.safety_commands import safety_topics
from drake_srg.scenario import Scenario

# A session whose only other process uses the keys and then goes to the background.
IN_THE_BACKGROUND = """
import os, pty, sys
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.keyboard import KeyboardBridge

session, keyboard = pty.fork()
if session:
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(session, 0)[1]))
process = os.fork()
if process == 0:
    bridge = KeyboardBridge(CommandInbox([], Warnings(print)), 0)
    os.setpgid(0, 0)
    bridge.close()
    os._exit(0)
status = os.waitpid(process, os.WUNTRACED)[1]
os._exit(1 if os.WIFSTOPPED(status) else os.waitstatus_to_exitcode(status))
"""


@pytest.fixture
def terminal():
    needs_pty()
    keyboard, terminal = os.openpty()
    yield keyboard, terminal
    os.close(keyboard)
    os.close(terminal)


@pytest.fixture
def inbox():
    return CommandInbox(safety_topics(["safety.estop"]), Warnings(print))


def test_keys_stop_and_release(terminal, inbox):
    bridge = KeyboardBridge(inbox, terminal[1])
    os.write(terminal[0], b"xe")
    wait_until(lambda: inbox.received == 1)
    assert inbox.take() == {"safety.estop": [1.0]}
    os.write(terminal[0], b"r")
    wait_until(lambda: inbox.received == 3)
    assert inbox.take() == {"safety.estop": [0.0], "safety.release": [1.0]}
    bridge.close()


def test_the_terminal_is_given_back(terminal, inbox):
    before = termios.tcgetattr(terminal[1])
    bridge = KeyboardBridge(inbox, terminal[1])
    assert termios.tcgetattr(terminal[1]) != before
    bridge.close()
    bridge.close()
    assert termios.tcgetattr(terminal[1]) == before


def test_the_terminal_is_given_back_from_the_background():
    needs_pty()
    command = [sys.executable, "-c", IN_THE_BACKGROUND]
    subprocess.run(command, check=True, timeout=60)


@pytest.mark.parametrize(("topics", "count"), [(["safety.estop"], 1), ([], 0)])
def test_keys_are_for_stations_with_a_monitor(terminal, topics, count):
    inbox = CommandInbox(safety_topics(topics), Warnings(print))
    options = BridgeOptions(terminal=terminal[1])
    bridges = options.connect(Scenario(), inbox, [])
    assert len(bridges) == count
    for bridge in bridges:
        bridge.close()


def test_it_keeps_no_station_alive(terminal, inbox):
    bridge = KeyboardBridge(inbox, terminal[1])
    assert bridge.closed
    bridge.close()


def test_only_a_terminal_in_the_foreground_has_keys(terminal):
    assert own_terminal(io.StringIO()) is None
    with Path(os.devnull).open() as nothing:
        assert own_terminal(nothing) is None
    # A terminal, but not this process's.
    with os.fdopen(os.dup(terminal[1])) as other:
        assert own_terminal(other) is None
