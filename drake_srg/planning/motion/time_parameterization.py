"""The fastest motions along paths, by TOPP-RA (Pham and Pham, 2018)."""

from __future__ import annotations

import contextlib
import importlib
import sys
import types
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydrake.multibody.optimization import Toppra
from pydrake.trajectories import BsplineTrajectory, Trajectory

from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.types import Vector


class TimeParameterization(Protocol):
    """Finds the fastest motion along a path."""

    def __call__(
        self,
        arm: ArmModel,
        path: BsplineTrajectory,
        limits: MotionLimits,
        grid: Vector,
    ) -> Trajectory | None:
        """Return the progress s(t) along a path, from rest to rest.

        Args:
            arm: The arm, with its payload.
            path: q(s), shape (N, 1) [rad], with nonzero derivative.
            limits: Limits of the motion at the points of the grid. Between them, the
                motion may exceed them a little.
            grid: Increasing values of s, shape (K,), from the path's start to its end.

        Returns:
            s(t) from t = 0, or None if the torque limits cannot hold the arm along the
            path.
        """


def MakeTimeParameterization(name: str) -> TimeParameterization:
    """Return a time parameterization: `toppra` or `drake`.

    It imports toppra, which takes 0.01 s.

    Raises:
        ValueError: If there is no such time parameterization.
    """
    if name == "drake":
        return drake_parameterization
    if name == "toppra":
        # toppra imports matplotlib, which it needs only to draw, and SciPy, which it
        # needs only for paths and a solver that we do not use. Importing both would
        # cost every command that plans a second. Stand-in modules are the only remedy:
        # the standard library's `LazyLoader` loads a module at the first `from MODULE
        # import NAME`, as toppra does, and toppra has no smaller part to import. They
        # can go once toppra imports the two only where it uses them (0.6.10 does not).
        with on_demand(
            "matplotlib",
            "matplotlib.pyplot",
            "scipy",
            "scipy.interpolate",
            "scipy.sparse",
        ):
            from drake_srg.planning.motion.toppra_parameterization import (
                toppra_parameterization,
            )

        return toppra_parameterization
    raise ValueError(f"time parameterization must be toppra or drake, got {name!r}")


class _OnDemand(types.ModuleType):
    """Stands in for a module until something in it is used."""

    def __getattr__(self, name: str) -> Any:
        if sys.modules.get(self.__name__) is not self:
            return getattr(importlib.import_module(self.__name__), name)
        # The import itself looks for submodules, and for the marks of a package.
        if name.startswith("__") or f"{self.__name__}.{name}" in sys.modules:
            raise AttributeError(name)
        return _MemberOnDemand(self, name)


class _MemberOnDemand:
    """Stands in for a class or function of such a module until it is used."""

    def __init__(self, module: _OnDemand, name: str) -> None:
        self._module, self._name = module, name

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return getattr(self._module, self._name)(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        return getattr(getattr(self._module, self._name), name)


@contextlib.contextmanager
def on_demand(*names: str) -> Iterator[None]:
    """Delay other imports of the modules imported in the block until their first use.

    The modules may call names that they import `from` the others, and read their
    attributes. They may not derive from such names or test for their instances.

    Args:
        names: The others, as in `import NAME`, including their parents.
    """
    waiting = {name: _OnDemand(name) for name in names if name not in sys.modules}
    sys.modules.update(waiting)
    try:
        yield
    finally:
        for name in waiting:
            del sys.modules[name]


def drake_parameterization(
    arm: ArmModel, path: BsplineTrajectory, limits: MotionLimits, grid: Vector
) -> Trajectory | None:
    """Solve with Drake's Toppra. See `TimeParameterization`.

    It may exceed the acceleration limit at the last point of the grid, and finds no
    motion along some paths that turn back on themselves.
    """
    # Drake's solver takes the positions of the whole plant.
    control = [arm.positions(point[:, 0])[:, None] for point in path.control_points()]
    # Toppra refers to the path without keeping it alive.
    whole_path = BsplineTrajectory(path.basis(), control)
    toppra = Toppra(whole_path, arm.plant, grid)
    toppra.AddJointVelocityLimit(*_bounds(arm, limits.velocity))
    toppra.AddJointAccelerationLimit(*_bounds(arm, limits.acceleration))
    toppra.AddJointTorqueLimit(*_bounds(arm, limits.torque))
    return toppra.SolvePathParameterization()


def _bounds(arm: ArmModel, limit: Vector) -> tuple[Vector, Vector]:
    """Return bounds on all positions of the plant, loose ones on fixed joints."""
    upper = np.full(arm.plant.num_positions(), 1e6)
    upper[arm.arm_indices] = np.minimum(limit, 1e6)
    return -upper, upper
