"""The command `drake-srg`: its commands, errors and exit codes."""

import argparse
import importlib.metadata
import io
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from drake_srg.cli import (
    arms,
    calibrate,
    commands,
    doctor,
    grasps,
    learn,
    objects,
    project,
    robot,
    sweep,
)
from drake_srg.cli import experiment as experiments
from drake_srg.cli.command import (
    BAD_INPUT,
    HELP,
    INTERRUPTED,
    JSON,
    QUIET,
    SUCCESS,
    UNWRITABLE,
    Command,
    Output,
    OutputError,
    command,
    end_on_signals,
    printing,
    sentence,
    tell,
)
from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.common.installing import with_install_hint


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: The command line without the program's name; None: from sys.argv.
    """
    # If the shell has closed a stream, it is None in Python, and `print` would write to
    # standard output instead.
    sys.stdout, sys.stderr = sys.stdout or _NullStream(), sys.stderr or _NullStream()
    try:
        try:
            return _run(sys.argv[1:] if arguments is None else arguments)
        finally:
            with printing():
                sys.stdout.flush()  # not at exit: errors are handled here
    except OutputError as error:
        _close_output()
        tell(f"standard output: cannot be written: {error}")
        return UNWRITABLE
    except BrokenPipeError:  # `| head` has read enough
        _close_output()
        return SUCCESS


class _NullStream(io.StringIO):
    """A stream that discards its input."""

    def write(self, text: str) -> int:
        return len(text)


def _close_output() -> None:
    """Discard the buffered output, which Python would write at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(arguments: Sequence[str]) -> int:
    CommandParser.json = "--json" in arguments
    options = make_parser().parse_args(arguments)
    output = Output(options.json, options.quiet, options.command)
    options.console, options.typed = output, arguments
    end_on_signals()
    try:
        code: int = options.run(options)
    except ScenarioError as error:
        output.complain(str(error))
        return BAD_INPUT
    except ImportError as error:
        output.complain(with_install_hint(str(error)))
        return BAD_INPUT
    except KeyboardInterrupt:
        output.complain("stopped")
        return INTERRUPTED
    return code


class CommandParser(argparse.ArgumentParser):
    """A parser that reports an error in one line."""

    json = False  # whether the command line contains --json

    def error(self, message: str) -> NoReturn:
        """Print the error, and exit."""
        Output(self.json, quiet=False).complain(message)
        sys.exit(BAD_INPUT)

    def parse_args(  # type: ignore[override] # only this overload is used
        self, args: Sequence[str]
    ) -> argparse.Namespace:
        """Return the options; exit with a suggestion if one is unknown."""
        options, unknown = self.parse_known_args(args)
        if unknown:
            parsers = _parsers(self)
            known = parsers.get(options.command, self)._option_string_actions
            words = [w for w in unknown if w.startswith("-")] or unknown
            hint = suggest(words[0].partition("=")[0], known)
            self.error(f"unknown argument {words[0]!r} {hint}")
        return options

    def print_help(self, file: Any = None) -> None:
        """Print the help. Unlike argparse's own method, report a failure to write."""
        with printing():
            print(self.format_help(), end="", file=file)

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Raise an error with a suggestion if a command or choice is unknown."""
        if action.choices is not None and value not in action.choices:
            hint = suggest(str(value), map(str, action.choices))
            raise argparse.ArgumentError(action, f"unknown {value!r} {hint}")

    def format_help(self) -> str:
        """Return the help text; in the overview, commands are in groups."""
        if self._subparsers is None:
            return super().format_help()
        lines = [self.description or "", "", "usage: drake-srg COMMAND ...", ""]
        for group, members in COMMANDS.items():
            for number, each in enumerate(members):
                first = "" if number else group
                lines.append(f"{first:7}{each.name:11}{sentence(each.summary)}")
        options = [
            (", ".join(action.option_strings), action.help or "")
            for action in self._actions
            if action.option_strings
        ]
        lines += ["", *(f"{names:18}{help}" for names, help in options)]
        return "\n".join([*lines, "", self.epilog or "", ""])


class _PrintVersion(argparse.Action):
    """Prints the version, which it looks up on disk only when needed."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        with printing():
            print(f"drake-srg {importlib.metadata.version('drake_srg')}")
        parser.exit()


def _parsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the commands by name."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


# Grouped by purpose, in the order of the overview.
COMMANDS: dict[str, tuple[Command, ...]] = {
    "run": (commands.demo, commands.run, commands.bench),
    "see": (commands.list_all, commands.replay, commands.diagram),
    "vary": (sweep.sweep, sweep.report, sweep.dataset, experiments.experiment),
    "learn": (learn.train, learn.evaluate, grasps.grasps),
    "robots": (robot.serve, robot.twin, calibrate.identify, calibrate.calibrate),
    "make": (
        project.new,
        objects.import_object,
        arms.import_arm,
        commands.export,
        doctor.doctor,
    ),
}


@command("print this", name="")
def _overview(options: argparse.Namespace) -> int:
    """Print the overview, like `--help`, for `drake-srg` without a command."""
    options.console.say(make_parser().format_help().rstrip())
    return SUCCESS


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands; `options.run(options)` runs the parsed one."""
    parser = CommandParser(
        prog="drake-srg",
        description="Robot cells with the SAKE Robotics gripper, simulated with Drake.",
        epilog="`drake-srg COMMAND --help` describes a command and its options.",
        add_help=False,
    )
    for add in (HELP, JSON, QUIET):
        add(parser)
    parser.add_argument(
        "--version", action=_PrintVersion, nargs=0, help="Print the version and exit."
    )
    parser.set_defaults(json=False, quiet=False, run=_overview.run, command="")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND")
    for members in COMMANDS.values():
        for each in members:
            each.add_to(subparsers)
    return parser
