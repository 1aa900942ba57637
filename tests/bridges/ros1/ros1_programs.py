"""ROS 1's own programs, as Debian has them."""

import contextlib
import json
import os
import queue
import subprocess
import threading
import xmlrpc.client
from pathlib import Path

from bridges.ros1.ros1_peers import free_port, wait_until


class Roscore:
    """The real master of ROS 1, with its node rosout, on a port of its own."""

    def __init__(self, home):
        self.port = free_port()
        self.uri = f"http://127.0.0.1:{self.port}"
        self.environment = {
            **os.environ,
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(home),  # where it logs
            "PYTHONUNBUFFERED": "1",
        }
        self._process = None

    def start(self):
        self._process = subprocess.Popen(
            ["roscore", "-p", str(self.port)],
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        assert wait_until(self.answers, 20.0)

    def answers(self):
        with contextlib.suppress(OSError, xmlrpc.client.Error):
            return xmlrpc.client.ServerProxy(self.uri).getPid("/test")[0] == 1
        return False

    def close(self):
        if self._process is not None:
            self._process.terminate()
            self._process.wait(20.0)

    def run(self, *command, timeout=20.0):
        """Run a program of ROS; return what it printed."""
        done = subprocess.run(
            command,
            env=self.environment,
            timeout=timeout,
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return done.stdout


class RospyClient:
    """A real rospy node, `ros1_client.py`."""

    def __init__(self, roscore):
        self._process = subprocess.Popen(
            ["/usr/bin/python3", Path(__file__).with_name("ros1_client.py")],
            env=roscore.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._received = queue.Queue()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        assert self.receive("ready") is None

    def subscribe(self, topic, kind):
        self._send(["subscribe", topic, kind])

    def publish(self, topic, kind, *values):
        self._send(["publish", topic, kind, values])

    def receive(self, topic):
        """The next message of a topic; others are skipped."""
        while True:
            name, message = self._received.get(timeout=10.0)
            if name == topic:
                return message

    def close(self):
        self._process.kill()
        self._process.wait()
        self._thread.join()
        self._process.stdin.close()
        self._process.stdout.close()

    def _send(self, command):
        self._process.stdin.write(json.dumps(command) + "\n")
        self._process.stdin.flush()

    def _read(self):
        for line in self._process.stdout:
            self._received.put(json.loads(line))
