"""A LeafSystem that Python's garbage collector can free.

Two things keep a system written in Python, and with it the whole diagram, alive forever
(measured with Drake 1.51.1 and 1.58; see tests/test_lifetime.py):

* Drake holds the callbacks of abstract output ports and cache entries in C++, where the
  collector cannot see them. A callback that is a bound method keeps its system alive.
  Before 1.58, this also applies to vector output ports. (Event callbacks do not leak.)
* Up to Python 3.11, a pybind11 class and a Python class derived from it both report the
  instance's `__dict__` to the collector. The collector then subtracts one reference too
  many, finds a negative count, and considers the system in use.

No simpler fix works: both references are counted in C++, before any code of ours runs,
and the collector would also subtract any extra reference that it sees. `collectable`
and `DeclareVectorOutputPort` can go once 1.58 is the oldest supported version.

The `LeafSystem` of this module is Drake's with both problems fixed. Derive from it.
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
    """Return a callable that holds only a weak reference to a bound method's object."""
    reference = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        bound = reference()
        assert bound is not None, "called after its system was freed"
        return bound(*arguments)

    return call


def collectable(system: framework.System) -> None:
    """Let the garbage collector count the references to a system correctly.

    If an instance reports its `__dict__` twice (see the module's docstring), this adds
    a second reference to it, from an object array: the collector does not traverse
    those. Otherwise, this does nothing.
    """
    attributes = system.__dict__
    if sum(shown is attributes for shown in gc.get_referents(system)) > 1:
        unseen = np.empty(1, dtype=object)
        unseen[0] = attributes
        attributes["_unseen_reference"] = unseen


def free_diagrams() -> None:
    """Free the diagrams that nothing uses any more.

    Left to itself, Python would collect too late: it counts the few objects of a
    diagram, not the megabytes behind them.
    """
    gc.collect()


def my_context(system: framework.System, root: framework.Context) -> framework.Context:
    """Return a system's context within `root`, or `root` itself if it is the system's.

    The result of Drake's `GetMyContextFromRoot` keeps `root` alive. If that result is
    `root` itself, the context, with its images, would keep itself alive forever.
    """
    try:
        system.ValidateContext(root)
    except RuntimeError:
        return system.GetMyContextFromRoot(root)
    return root


class LeafSystem(framework.LeafSystem):
    """Drake's LeafSystem, but freed with the diagram that holds it.

    It holds output port callbacks weakly if they are methods of the system. Everything
    else is as in Drake. Wrap the callbacks of a cache entry's ValueProducer in `weak`.
    """

    def __init__(self) -> None:
        super().__init__()
        collectable(self)

    def DeclareVectorOutputPort(self, *args: Any, **kwargs: Any) -> Any:
        """Declare the port as Drake does, holding the system's own methods weakly."""
        args, kwargs = self._weakly(args, kwargs)
        return super().DeclareVectorOutputPort(*args, **kwargs)

    def DeclareAbstractOutputPort(self, *args: Any, **kwargs: Any) -> Any:
        """Declare the port as Drake does, holding the system's own methods weakly."""
        args, kwargs = self._weakly(args, kwargs)
        return super().DeclareAbstractOutputPort(*args, **kwargs)

    def _weakly(
        self, args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> tuple[tuple[Any, ...], dict[str, Any]]:
        def held(value: Any) -> Any:
            own = inspect.ismethod(value) and value.__self__ is self
            return weak(value) if own else value

        return tuple(map(held, args)), {k: held(v) for k, v in kwargs.items()}
