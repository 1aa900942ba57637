"""The underactuated SAKE Robotics gripper and its robot cells as Drake diagrams.

The names below are the package's face. Each is imported on first use, so that
`import drake_srg` takes a few milliseconds; `__init__.pyi` tells type checkers of them.
"""

import importlib
from typing import Any

_HOMES = {
    "Blob": "drake_srg.types",
    "Failure": "drake_srg.types",
    "LeafSystem": "drake_srg.lifetime",
    "MakeCell": "drake_srg.station",
    "MakeStation": "drake_srg.station",
    "Mode": "drake_srg.types",
    "Rig": "drake_srg.simulation.rig",
    "Scenario": "drake_srg.scenario",
    "Simulate": "drake_srg.simulation",
    "load_scenario": "drake_srg.scenario",
}

__all__ = [
    "Blob",
    "Failure",
    "LeafSystem",
    "MakeCell",
    "MakeStation",
    "Mode",
    "Rig",
    "Scenario",
    "Simulate",
    "__version__",
    "load_scenario",
]


def __getattr__(name: str) -> Any:
    """Import a name of the face (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("drake_srg")
    elif name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
