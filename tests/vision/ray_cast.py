"""Exact depth images of cylinders over a table, without a renderer."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from drake_srg.vision.camera import CameraModel
from drake_srg.vision.sight import view_around

# A small camera straight above the table z = 0, on which a pixel is 1.3 mm wide.
INFO = CameraInfo(160, 120, np.deg2rad(10.0))
X_WC = RigidTransform(RotationMatrix(np.diag([1.0, -1.0, -1.0])), [0.0, 0.0, 0.9])


def lying(shape, tilt, yaw, x=0.0, y=0.0):
    """Return pose and axis of a cylinder on the table, tilted from upright [rad]."""
    level = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    axis = np.sin(tilt) * level + [0.0, 0.0, np.cos(tilt)]
    z = 0.5 * shape.length * np.cos(tilt) + shape.radius * np.sin(tilt)
    R = RotationMatrix.MakeFromOneVector(axis, 2)
    return RigidTransform(R, [x, y, z]), axis


def cast(shape, X_WO, rays, origin):
    """Return how far along its ray each pixel sees a cylinder; infinite beside it."""
    R = X_WO.rotation().matrix()
    p, d = R.T @ (origin - X_WO.translation()), rays @ R
    half = 0.5 * shape.length
    with np.errstate(all="ignore"):
        a = (d[..., :2] ** 2).sum(axis=-1)
        b = (d[..., :2] * p[:2]).sum(axis=-1)
        t = (-b - np.sqrt(b**2 - a * (p[:2] @ p[:2] - shape.radius**2))) / a
        nearest = np.where(np.abs(p[2] + t * d[..., 2]) <= half, t, np.inf)
        for end in (-half, half):
            t = (end - p[2]) / d[..., 2]
            at_end = p[:2] + t[..., None] * d[..., :2]
            hit = (at_end**2).sum(axis=-1) <= shape.radius**2
            nearest = np.where(hit, np.fmin(nearest, t), nearest)
    return nearest


def view_of(shape, X_WO, others=(), info=INFO, X_WC=X_WC, noise=0.0, seed=0):
    """Return the view of a cylinder above the table z = 0, and of others."""
    imager = CameraModel(info).imager("depth")
    rays = imager.rays(slice(0, info.width()), slice(0, info.height()))
    rays = rays @ X_WC.rotation().matrix().T
    origin = X_WC.translation()
    own = cast(shape, X_WO, rays, origin)
    rest = [cast(*other, rays, origin) for other in others]
    rest = np.min([-origin[2] / rays[..., 2], *rest], axis=0)
    depth = np.minimum(own, rest)
    depth += np.random.default_rng(seed).normal(0.0, noise, depth.shape)
    depth = depth.astype(np.float32)
    blob = own < rest
    return view_around(shape, blob, blob, depth, imager, imager, X_WC)
