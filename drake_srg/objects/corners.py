"""How far a body's collision geometry reaches."""

import itertools

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from drake_srg.types import Vector

_FAR = 1e3  # half the size of a half space [m]


def body_corners(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> Vector:
    """Return the corners of the boxes around each of a body's collision geometries.

    Returns:
        Positions in the body's frame, shape (n, 3) [m].
    """
    corners = []
    for geometry in plant.GetCollisionGeometriesForBody(body):
        X_BG = inspector.GetPoseInFrame(geometry)
        box = inspector.GetObbInGeometryFrame(geometry)
        half = np.full(3, _FAR) if box is None else box.half_width()
        X_BO = X_BG if box is None else X_BG @ box.pose()
        for signs in itertools.product((-1.0, 1.0), repeat=3):
            corners.append(X_BO @ (np.array(signs) * half))
    return np.array(corners)
