"""ROS 1's own programs, from Debian packages."""

import contextlib
import json
import os
import queue
import subprocess
import threading
import xmlrpc.client
from pathlib import Path

from robot.serve.ros1.peers import free_port
from robot.serve.waiting import wait_until


class Roscore:
    """ROS 1's real master, with its node rosout, on a port of its own."""

    def __init__(self, home):
        self.port = free_port()
        self.uri = f"http://127.0.0.1:{self.port}"
        self.environment = {
            **os.environ,
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(home),  # for logs
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

    def run(self, *command, until=None, timeout=20.0):
        """Run a program of ROS and return its output.

        Args:
            command: The program and its arguments.
            until: Words that end a program which would run forever.
            timeout: Time after which to kill the program [s].
        """
        process = subprocess.Popen(
            command,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        killer = threading.Timer(timeout, process.kill)
        killer.start()
        output = ""
        with process:
            for line in process.stdout:
                output += line
                if until is not None and until in line:
                    process.terminate()
        killer.cancel()
        return output


class RospyClient:
    """A real rospy node, `rospy_client.py`."""

    def __init__(self, roscore):
        self._process = subprocess.Popen(
            ["/usr/bin/python3", Path(__file__).with_name("rospy_client.py")],
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
        """Return the next message of a topic, skipping others."""
        while True:
            name, message = self._received.get(timeout=20.0)
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
