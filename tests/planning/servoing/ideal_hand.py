"""A servo with an arm that follows perfectly and a camera that sees ideal features."""

import dataclasses as dc
import functools

import numpy as np
from helpers import fix, read
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from drake_srg.planning.servoing.config import ServoCommand, ServoConfig
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.planning.servoing.tracker import Capture, FeatureSighting, PoseSighting
from drake_srg.planning.servoing.visual_servo import ImageBasedServo, PositionBasedServo
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

# Binary fractions, so that times of updates are exact.
CONFIG = ServoConfig(period=0.0078125, camera_period=0.03125)
HOME = np.array([0.0, 0.3, 0.0, -1.6, 0.0, 1.2, 0.0])  # hand down over the table
AHEAD = np.array([1.0, 0.0, 0.0])  # of the palm
X_GC = RigidTransform(RollPitchYaw(np.deg2rad([-120, 0, -90])), [0.0, 0.0, 0.085])
X_GO = RigidTransform([0.18, 0.0, 0.0])  # the object in the hand that has reached it
# Corners of the object, on no plane.
CORNERS = 0.03 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])


@functools.cache
def arm():
    return ServoArm(MakeModelsPlant(load_scenario("kitchen")))


def features(X_CO, frame=0, limit=0.6):
    """The image points of the corners; none if one is beyond the image's border."""
    p = (X_CO.rotation().matrix() @ CORNERS.T).T + X_CO.translation()
    points = p[:, :2] / p[:, 2:]
    if np.any(p[:, 2] < 0.02) or np.max(np.abs(points)) > limit:
        return FeatureSighting(frame)
    return FeatureSighting(frame, points, p[:, 2])


# Each kind of servo, and what its camera sees of an object.
KINDS = {
    "pbvs": (PositionBasedServo, lambda X_CO, frame=0: PoseSighting(frame, X_CO)),
    "ibvs": (ImageBasedServo, features),
}


class IdealHand:
    """Runs a servo of either kind, one control period at a time.

    `X_WO` is the object's pose at the start, `velocity` its own, `X_GC_believed` where
    the servo believes the camera to be.
    """

    def __init__(
        self,
        kind,
        X_WO,
        velocity=(0.0, 0.0, 0.0),
        X_GC_believed=X_GC,
        config=None,
        q=HOME,
    ):
        self.config = config or CONFIG
        self.X_WO = X_WO
        self.velocity = np.array(velocity)
        servo, self.see = KINDS[kind]
        goal = self.see(X_GC.inverse() @ X_GO)
        self.servo = servo(arm(), X_GC_believed, AHEAD, goal, self.config)
        self.simulator = Simulator(self.servo)
        self.context = self.simulator.get_mutable_context()
        self.q, self.time, self.frame = np.array(q), 0.0, 0
        self.fix(command=ServoCommand.TRACK)

    def fix(self, command):
        fix(self.servo, self.context, command=AbstractValue.Make(command))

    def X_WO_now(self):
        moved = RigidTransform(self.velocity * self.time)
        return moved @ self.X_WO

    def sight(self):
        """The present image of the camera."""
        X_CO = (arm().X_WG(self.q) @ X_GC).inverse() @ self.X_WO_now()
        self.frame += 1
        return self.see(X_CO, self.frame)

    def tick(self, sighting=None, planned=None):
        """Advance by a control period, and return the status."""
        sighting = self.sight() if sighting is None else sighting
        fix(
            self.servo,
            self.context,
            position_planned=self.q if planned is None else planned,
            arm_state=np.concatenate([self.q, np.zeros(7)]),
            sighting=AbstractValue.Make(sighting),
        )
        self.time += self.config.period
        self.simulator.AdvanceTo(self.time)
        self.q = read(self.servo, self.context, "position_commanded")
        return self.status

    @property
    def status(self):
        return read(self.servo, self.context, "status")

    def run(self, seconds, sighting=None):
        """Advance; return the statuses."""
        count = round(seconds / self.config.period)
        return [self.tick(sighting) for _ in range(count)]

    def away(self):
        """How far the hand is from where it must be now [m]."""
        X_WG_goal = self.X_WO_now() @ X_GO.inverse()
        X_WG = arm().X_WG(self.q)
        return float(np.linalg.norm(X_WG_goal.translation() - X_WG.translation()))


class LateHand(IdealHand):
    """An ideal hand whose images arrive 0.1 s late, until the camera falls silent."""

    def __init__(self, *arguments, **settings):
        super().__init__(*arguments, **settings)
        self.silent, self._taken = False, []
        self._latest = dc.replace(super().sight(), taken=Capture())

    def sight(self):
        ticks = round(self.time / self.config.period)
        if ticks % round(self.config.camera_period / self.config.period) == 0:
            taken = Capture(self.time, self.q)
            self._taken.append(dc.replace(super().sight(), taken=taken))
        arrived = [s for s in self._taken if s.taken.time <= self.time - 0.1]
        if arrived and not self.silent:
            self._latest = arrived[-1]
        return self._latest


def object_at(offset):
    """The object's pose if a hand at HOME is `offset` (3,) [m] from its goal."""
    X_WG = arm().X_WG(HOME)
    return RigidTransform(offset) @ X_WG @ X_GO
