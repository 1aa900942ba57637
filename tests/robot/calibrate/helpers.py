"""Views of a board that a known camera would see."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.robot.calibrate.mounting import Board
from drake_srg.robot.calibrate.solve import Unknowns, View, project

BOARD = Board()
FOCAL, CENTER = np.array([580.0, 577.0]), np.array([321.0, 238.0])


def pose(rpy, p):
    """A pose from angles [rad] and a position [m]."""
    return RigidTransform(RollPitchYaw(rpy), p)


def truth(X_PC, X_QB):
    """A camera at `X_PC` [m] and a board at `X_QB` [m]."""
    return Unknowns(FOCAL, CENTER, X_PC, X_QB)


def make_views(camera, count=20, noise=0.0, seed=0, tilt=0.6):
    """Views of the board before the camera, at random and tilted up to `tilt` [rad]."""
    rng = np.random.default_rng(seed)
    corners = BOARD.corners
    views = []
    for i in range(count):
        X_CM = pose(  # the middle of the board
            [*rng.uniform(-tilt, tilt, 2), rng.uniform(-np.pi, np.pi) * (tilt > 0)],
            [*rng.uniform(-0.2, 0.2, 2), rng.uniform(0.6, 1.1)],
        )
        X_CB = X_CM @ RigidTransform(-BOARD.center)
        X_PQ = camera.X_PC @ X_CB @ camera.X_QB.inverse()
        view = View(f"view_{i:02d}", X_PQ, corners, np.zeros((len(corners), 2)))
        pixels = project(camera, view) + noise * rng.normal(size=(len(corners), 2))
        views.append(View(view.name, X_PQ, corners, pixels))
    return views
