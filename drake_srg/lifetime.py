"""A LeafSystem that Python's garbage collector can free.

Two things keep systems written in Python, and with them their whole diagram, alive for
ever (measured with Drake 1.51.1; see tests/test_lifetime.py):

* Drake holds the callback of an output port or a cache entry from C++, where the
  collector cannot see it. A bound method holds its system. (Events are spared.)
* Up to Python 3.11 a pybind11 class and a Python class derived from it both show the
  collector the instance's `__dict__`. It then subtracts one reference too many, finds
  a negative count, and takes the system for one that is in use.

`LeafSystem` here is Drake's with both put right; derive from it.
"""

from __future__ import annotations

import gc
import inspect
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.systems import framework


def weak(method: Callable[..., Any]) -> Callable[..., Any]:
    """A callable that calls a bound method without keeping its object alive."""
    reference = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        bound = reference()
        assert bound is not None, "called after its system was freed"
        return bound(*arguments)

    return call


def collectable(system: framework.System) -> None:
    """Let the collector count the references of a system right; see the module.

    Where an instance shows its `__dict__` twice, a second reference is held by an
    object array, which the collector does not look into. Elsewhere this does nothing.
    """
    attributes = system.__dict__
    if sum(shown is attributes for shown in gc.get_referents(system)) > 1:
        unseen = np.empty(1, dtype=object)
        unseen[0] = attributes
        attributes["_unseen_reference"] = unseen


def my_context(system: framework.System, root: framework.Context) -> framework.Context:
    """Return a system's context within that of the root diagram, or that itself.

    Drake's `GetMyContextFromRoot` lets what it returns keep `root` alive: a root that
    is asked for its own context keeps itself alive, images and all, for ever.
    """
    try:
        system.ValidateContext(root)
    except RuntimeError:
        return system.GetMyContextFromRoot(root)
    return root


class LeafSystem(framework.LeafSystem):
    """Drake's LeafSystem, freed with the diagram that holds it.

    Output port callbacks that are methods of the system are held weakly; everything
    else is as in Drake. Pass the callbacks of a cache entry's ValueProducer through
    `weak`.
    """

    def __init__(self) -> None:
        super().__init__()
        collectable(self)

    def DeclareVectorOutputPort(self, *args: Any, **kwargs: Any) -> Any:
        """Drake's, with its own methods held weakly."""
        args, kwargs = self._weakly(args, kwargs)
        return super().DeclareVectorOutputPort(*args, **kwargs)

    def DeclareAbstractOutputPort(self, *args: Any, **kwargs: Any) -> Any:
        """Drake's, with its own methods held weakly."""
        args, kwargs = self._weakly(args, kwargs)
        return super().DeclareAbstractOutputPort(*args, **kwargs)

    def _weakly(
        self, args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> tuple[tuple[Any, ...], dict[str, Any]]:
        def held(value: Any) -> Any:
            own = inspect.ismethod(value) and value.__self__ is self
            return weak(value) if own else value

        return tuple(map(held, args)), {k: held(v) for k, v in kwargs.items()}
