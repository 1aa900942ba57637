"""The command `drake-srg new`, which starts a project."""

from __future__ import annotations

import argparse
import importlib.util
import keyword
import re
import shutil
import tempfile
from pathlib import Path

from drake_srg.cli.command import SUCCESS, argument, command, writing
from drake_srg.common.exceptions import ScenarioError

_TEMPLATES = Path(__file__).with_name("template")
_PLACE = "@NAME@"
_MODULES = ("cell", "test_cell")  # modules of every project


@command(
    "start a project: scenario, localizer, test, notebook",
    "",
    argument("name", metavar="NAME", help="name of the project and its folder"),
)
def new(options: argparse.Namespace) -> int:
    """Write a project into a new folder, and print its files and the next step."""
    with writing("NAME", Path(options.name)):
        here = Path.cwd()  # fails if the folder was deleted
    folder = make_project(options.name, here)
    files = sorted(folder.iterdir())
    options.console.say(*(path.relative_to(here) for path in files))
    options.console.say("", f"Next: cd {options.name} && python -m pytest")
    options.console.answer({"project": folder, "files": [path.name for path in files]})
    return SUCCESS


def make_project(name: str, parent: Path) -> Path:
    """Write a project, and return its folder.

    Args:
        name: Name of the project and of its folder.
        parent: Parent of the folder.

    Raises:
        ScenarioError: If the name is invalid or taken, or the folder cannot be written.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise ScenarioError(
            f"NAME {name!r}: invalid (allowed: a-z, 0-9 and _, starting with a letter, "
            "no Python keyword)"
        )
    folder = parent / name
    if folder.exists():
        raise ScenarioError(f"NAME {name}: {folder} already exists")
    if importlib.util.find_spec(name) is not None or name in _MODULES:
        raise ScenarioError(f"NAME {name}: a Python module has this name")
    with (
        writing("NAME", folder),
        tempfile.TemporaryDirectory(prefix=f".{name}.", dir=parent) as hidden,
    ):
        draft = Path(hidden) / name
        draft.mkdir()
        for template in _TEMPLATES.glob("*.in"):
            text = template.read_text("utf-8").replace(_PLACE, name)
            file = template.stem.replace("scenario", name).replace("dot_", ".")
            (draft / file).write_text(text, encoding="utf-8")
        shutil.move(draft, folder)
    return folder
