"""Optional packages, system libraries, and the commands that install missing ones."""

import ctypes
import importlib
import os
import shlex
import sys
from pathlib import Path
from types import ModuleType

# Libraries that Drake's wheel needs but does not contain, and the packages of Debian
# and Ubuntu that contain them; tools/install_system_libraries.sh has the same list.
# Importing Drake needs the first, rendering the others.
LIBRARIES = {
    "libglib-2.0.so.0": "libglib2.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
}


def require(module: str, extra: str, who: str) -> ModuleType:
    """Import a module that this package, or one of its extras, depends on.

    Args:
        module: Name of the module.
        extra: Name of the extra; empty if the package itself needs the module.
        who: Start of the message, with a verb, such as `Recording needs`.

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


def require_rendering() -> None:
    """Check for the libraries that Drake's renderers need: without them, they crash.

    Raises:
        ImportError: If a library is missing; the message says how to install it.
    """
    if not sys.platform.startswith("linux"):
        return
    for library in LIBRARIES:
        try:
            ctypes.CDLL(library)
        except OSError:
            raise ImportError(
                f"Rendering needs {library}, which is not installed. "
                f"Run: {apt_install(*LIBRARIES.values())}"
            ) from None


def apt_install(*packages: str) -> str:
    """Return the command that installs packages of Debian or Ubuntu."""
    sudo = "" if os.geteuid() == 0 else "sudo "
    return (
        f"{sudo}apt-get update && "
        f"{sudo}apt-get install -y --no-install-recommends {' '.join(packages)}"
    )


def library_fix(message: str) -> str:
    """Return the command that installs the library named by an error, or ""."""
    if any(library.split(".so")[0] in message for library in LIBRARIES):
        return apt_install(*LIBRARIES.values())
    return ""


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


def with_install_hint(message: str) -> str:
    """Return the message of an ImportError with the command that fixes it."""
    fix = library_fix(message)
    if fix and fix not in message:
        message = f"{message}. Run: {fix}"
    return f"{message}. `drake-srg doctor` lists everything missing."
