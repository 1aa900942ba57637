"""The underactuated SAKE Robotics gripper and its robot cells as Drake diagrams.

`__init__.pyi` lists the package's public names, and each subpackage has its own list.
"""

from typing import Any

from drake_srg.face import face

_get, __dir__, __all__ = face(__name__)


def __getattr__(name: str) -> Any:
    """Import a public name; `__version__` is that of the installed package."""
    if name != "__version__":
        return _get(name)
    from importlib.metadata import version

    return version("drake_srg")
