"""Commands that install what is missing, for messages."""

import shlex
import sys
from pathlib import Path


def pip_install(*arguments: str) -> str:
    """Return the command that installs packages for the interpreter that runs."""
    return shlex.join([sys.executable, "-m", "pip", "install", *arguments])


def this_package(extra: str = "") -> list[str]:
    """Return pip's arguments for this package: a checkout of it, or a release."""
    suffix = f"[{extra}]" if extra else ""
    checkout = Path(__file__).resolve().parents[1]
    if (checkout / "pyproject.toml").is_file():
        return ["-e", f"{checkout}{suffix}"]
    return [f"drake_srg{suffix}"]
