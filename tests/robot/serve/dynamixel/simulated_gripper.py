"""The simulated gripper behind a servo bridge, as fast as it goes."""

import threading

from drake_srg.robot.serve.dynamixel.bridge import ServoBridge
from drake_srg.robot.serve.loop import Serve
from drake_srg.scenario import load_scenario
from robot.serve.waiting import wait_until

# Pointing forwards: downwards, the fingers would fall shut against their springs.
_FRONT = "directives.gripper::palm.add_weld.X_PC.rotation=!Rpy {deg: [0, 0, 0]}"


class SimulatedGripper:
    """An empty gripper whose simulated time is its clients' clock.

    Attributes:
        bridge: Its servo.
        time: Simulated [s].
        q: Positions of the finger joints [rad].
        force: Force of the wires [N].
        told: Warnings so far.
    """

    def __init__(self, where, protocol=1):
        self._where, self._protocol = where, protocol
        self.time, self.told = 0.0, []
        self._ready, self._stop = threading.Event(), threading.Event()

    def sleep(self, duration):
        end = self.time + duration
        assert wait_until(lambda: self.time >= end, 60.0)

    def __enter__(self):
        scenario = load_scenario(
            "gripper_bench_fast", overrides=["object.present=false", _FRONT]
        )
        self._served = threading.Thread(
            target=lambda: Serve(
                scenario,
                self._connect,
                rate=0.0,
                stop=self._stop,
                tell=self.told.append,
            ),
            daemon=True,
        )
        self._served.start()
        assert self._ready.wait(60.0)
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._served.join(60.0)

    def _connect(self, inbox, topics):
        seen = self

        class Watched(ServoBridge):
            def update(self, time, values):
                super().update(time, values)
                seen.q = values["gripper.state_measured"][:4].copy()
                seen.force = values["gripper.wire_force"].copy()
                seen.time = time

        self.bridge = Watched(inbox, self._where, protocol=self._protocol)
        more = ("gripper.state_measured", "gripper.wire_force")
        self.bridge.ports = (*self.bridge.ports, *more)
        self._ready.set()
        return [self.bridge]
