"""A quick import of toppra, which finds the fastest motions along paths."""

from __future__ import annotations

import contextlib
import importlib
import sys
import types
from collections.abc import Callable, Iterator
from typing import Any

from pydrake.trajectories import BsplineTrajectory, PiecewisePolynomial

from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.types import Vector


def load_toppra() -> Callable[
    [ArmModel, BsplineTrajectory, MotionLimits, Vector], PiecewisePolynomial | None
]:
    """Return `toppra_parameterization`; the first call imports toppra in 0.4 s."""
    # toppra imports matplotlib, which it needs only to draw, and SciPy, which it needs
    # only for paths and a solver that we do not use. Importing both would slow every
    # command that plans by a second. Stand-in modules are the only remedy: the standard
    # library's `LazyLoader` loads a module at the first `from MODULE import NAME`, as
    # toppra does, and toppra has no smaller part to import. They can go once toppra
    # imports the two only where it uses them (0.6.10 does not).
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
    """Defer the import of some modules within the block until their first use.

    Modules that the block imports may call names that they import `from` a deferred
    module, and read attributes of such names. They must not derive from such names or
    test for instances of them.

    Args:
        names: The deferred modules, as in `import NAME`, including their parents.
    """
    waiting = {name: _OnDemand(name) for name in names if name not in sys.modules}
    sys.modules.update(waiting)
    try:
        yield
    finally:
        for name in waiting:
            del sys.modules[name]
