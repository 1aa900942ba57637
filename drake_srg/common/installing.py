"""Optional packages, and the commands that install missing ones."""

import importlib
import shlex
import sys
from pathlib import Path
from types import ModuleType


def require(module: str, extra: str, who: str) -> ModuleType:
    """Import a module that belongs to one of this package's extras.

    Args:
        module: Name of the module.
        extra: Name of the extra.
        who: Start of the message, with a verb: `Recording needs`.

    Raises:
        ImportError: If the module is missing; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f"{who} {package!r}, which is not installed. "
            f"Run: {pip_install(*this_package(extra))}"
        ) from error


def pip_install(*arguments: str) -> str:
    """Return the command that installs packages for the running interpreter."""
    return shlex.join([sys.executable, "-m", "pip", "install", *arguments])


def this_package(extra: str = "") -> list[str]:
    """Return pip's arguments for this package, a checkout or a release."""
    suffix = f"[{extra}]" if extra else ""
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "pyproject.toml").is_file():
        return ["-e", f"{checkout}{suffix}"]
    return [f"drake_srg{suffix}"]
