"""Processes that talk DDS with the ROS 2 bridge, in a domain of their own."""

import fcntl
import json
import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
from collections import deque
from pathlib import Path
from typing import TextIO

import numpy as np

from drake_srg.robot.serve.commands import CommandError, CommandTopic
from robot.serve.waiting import wait_until

COMMANDS = {
    "/grasp": ("Int32", 42),
    "/startgrasp": ("Bool", True),
    "/position_grasp": ("Float64MultiArray", [0.1, 0.2, 0.3, 0.4]),
    "/kuka": ("Float64MultiArray", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
}


# The locks of the last domains given out: a test uses one domain, and what it leaves
# behind is gone before the lock is.
_HELD: deque[TextIO] = deque(maxlen=8)


def free_domain():
    """Return a domain that no participant and no other test on this machine uses."""
    stem = Path(tempfile.gettempdir(), f"drake_srg_test_{os.getuid()}_domain_")
    # The ports of higher domains are among the system's ephemeral ports.
    for domain in random.SystemRandom().sample(range(1, 101), 100):
        lock = Path(f"{stem}{domain}").open("w")  # noqa: SIM115 outlives the function
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # DDSI's formula for the port of the first participant.
                probe.bind(("127.0.0.1", 7400 + 250 * domain + 10))
            except OSError:
                lock.close()
                continue
        _HELD.append(lock)
        return domain
    raise OSError("all domains are in use")


def command_topics():
    """Return topics whose commands are their data, by topic name."""

    def topic(name, kind, size=None):
        def convert(data):
            values = np.atleast_1d(np.asarray(data, dtype=float))
            if size is not None and values.size != size:
                raise CommandError("length", f"needs {size}")
            if not np.isfinite(values).all():
                raise CommandError("finite", "is not finite")
            return {name: values, "last": name}

        return CommandTopic(name, f"std_msgs/msg/{kind}", convert)

    return [
        topic("/grasp", "Int32"),
        topic("/startgrasp", "Bool"),
        topic("/position_grasp", "Float64MultiArray", 4),
        topic("/kuka", "Float64MultiArray", 7),
    ]


class Peer:
    """A process that answers every line with a line, such as `dds_peer.py`."""

    def __init__(self, *command):
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.read()

    def read(self):
        line = self._process.stdout.readline()
        assert line, "the peer has ended"
        return line.strip()

    def ask(self, line):
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        return self.read()

    def signal(self, number):
        self._process.send_signal(number)

    def close(self):
        with self._process:  # closes the pipes, which ends the program; then waits
            killer = threading.Timer(5.0, self._process.kill)
            killer.start()
        killer.cancel()


class CyclonePeer(Peer):
    """A process `dds_peer.py`; it has the methods of `dds_peer.Peer`."""

    def __init__(self, domain):
        program = Path(__file__).with_name("dds_peer.py")
        super().__init__(sys.executable, program, str(domain))

    def __getattr__(self, order):
        return lambda *arguments: json.loads(self.ask(json.dumps([order, *arguments])))


def advertise(inbox, peer, *topics, reliable=True):
    """Create publishers, and wait until they and the bridge know each other."""
    # The bridge has two readers per topic; a best-effort writer matches one of them.
    readers = 2 if reliable else 1
    for topic in topics:
        peer.advertise(topic, COMMANDS[topic][0], reliable)
        assert wait_until(lambda topic=topic: peer.subscribers(topic) == readers)
    peer.introduce()
    assert received(inbox, 1)
    inbox.take()
    inbox.received = 0


def received(inbox, count):
    return wait_until(lambda: inbox.received >= count) and inbox.received == count
