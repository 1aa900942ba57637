"""The reference of commands, made from their parser."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Mapping

from drake_srg.cli.command import COMMAND_PAGES
from drake_srg.cli.main import make_parser
from make_site.markdown import code, page_title, table


def command_parsers() -> Mapping[str, argparse.ArgumentParser]:
    """Return the parser of each command by its name."""
    for action in make_parser()._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    raise AssertionError("drake-srg has no commands")


def commands_page() -> str:
    """Return a section per command: usage, description, arguments."""
    return "\n".join(
        _section(name, parser) for name, parser in command_parsers().items()
    )


def _section(name: str, parser: argparse.ArgumentParser) -> str:
    usage = textwrap.dedent(parser.format_usage().removeprefix("usage: "))
    rows = [
        (_spelled(action), _help(action))
        for action in parser._actions
        if action.help != argparse.SUPPRESS
    ]
    page = COMMAND_PAGES.get(name, "").removeprefix("docs/")
    more = f"\nSee [{page_title(page)}](../{page}).\n" if page else ""
    return (
        f"## {name}\n\n{parser.description}\n{more}\n"
        f"```text\n{usage}```\n\n{table(('argument', 'meaning'), rows)}"
    )


def _spelled(action: argparse.Action) -> str:
    """Return an argument as one types it."""
    names = action.option_strings or [""]
    value = action.metavar or ("" if action.nargs == 0 else action.dest.upper())
    if action.choices is not None:
        value = "{" + ", ".join(map(str, action.choices)) + "}"
    return ", ".join(code(f"{name} {value}".strip()) for name in names)


def _help(action: argparse.Action) -> str:
    text = action.help or ""
    values = {key: str(value) for key, value in vars(action).items()}
    return text % values if "%(" in text else text
