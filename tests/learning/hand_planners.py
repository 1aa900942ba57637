"""Fixtures for planners of a hand that points down."""

from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.types import Blob


class Straight:
    """A gantry whose joints are the hand's pose."""

    def pose(self, q):
        return q

    def follow(self, q, pose):
        return pose


def blob(rpy=(0.0, 0.0, 0.3), name="thing"):
    """Return what a localizer sees of a thing at (0.2, 0.1, 0.04)."""
    X_WO = RigidTransform(RollPitchYaw(rpy), [0.2, 0.1, 0.04])
    return Blob(name, "ceiling", (0.0, 0.0), X_WO, 1.0)
