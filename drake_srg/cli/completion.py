"""The command completion, which prints a shell's completion script."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import drake_srg
from drake_srg.cli.process import SUCCESS
from drake_srg.common.installing import require

SHELLS = ("bash", "zsh", "fish")
USE = (
    'In bash: eval "$(drake-srg completion bash)". In zsh, write it to a file '
    "`_drake-srg` on the `fpath`; in fish, to "
    "~/.config/fish/completions/drake-srg.fish."
)


def completion(options: argparse.Namespace) -> int:
    """Print the script that completes `drake-srg` in a shell.

    It completes commands, options, scenarios, formats and paths.
    """
    shtab = require("shtab", "", "Completion needs")
    parser: argparse.ArgumentParser = options.make_parser()
    # Drake is not imported to list them: a shell may run this whenever it starts.
    folder = Path(drake_srg.__file__).with_name("scenarios")
    scenarios = sorted(path.stem for path in folder.glob("*.yaml"))
    for action in _actions(parser):
        if action.dest == "scenario":
            action.choices = scenarios
        elif action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined] # shtab's
    script = shtab.complete(parser, shell=options.shell)
    options.console.say(script)
    options.console.answer({"script": script})
    return SUCCESS


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
