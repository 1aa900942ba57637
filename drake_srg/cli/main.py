"""The command `drake-srg`: its commands, errors and exit codes."""

import argparse
import importlib.metadata
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import drake_srg
from drake_srg.cli import commands, doctor
from drake_srg.cli import commands as cli_export
from drake_srg.cli import commands as cli_new
from drake_srg.cli import experiment as cli_experiment
from drake_srg.cli import learn as cli_learn
from drake_srg.cli import objects as cli_objects
from drake_srg.cli import robot as cli_calibrate
from drake_srg.cli import robot as cli_identify
from drake_srg.cli import robot as cli_serve
from drake_srg.cli import robot as cli_twin
from drake_srg.cli import sweep as cli_sweep
from drake_srg.cli.command import BAD_INPUT, SUCCESS, Output, argument, command
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.installing import advised, require

SHELLS = ("bash", "zsh", "fish")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: The command line without the program's name; None: sys.argv's.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    CommandParser.json = "--json" in arguments
    options = make_parser().parse_args(arguments)
    output = Output(options.json, options.quiet, options.command)
    options.console = output
    try:
        code: int = options.run(options)
        sys.stdout.flush()  # here, where a broken pipe is handled, not at exit
    except ScenarioError as error:
        output.complain(str(error))
        return BAD_INPUT
    except ImportError as error:
        output.complain(advised(str(error)))
        return BAD_INPUT
    except KeyboardInterrupt:
        output.complain("stopped")
        return BAD_INPUT
    except BrokenPipeError:  # `| head` has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    return code


class CommandParser(argparse.ArgumentParser):
    """A parser that reports an error in one line, like every command."""

    json = False  # whether the command line asks for it

    def error(self, message: str) -> NoReturn:
        """Print what is wrong, and exit."""
        Output(self.json, quiet=False).complain(message)
        sys.exit(BAD_INPUT)


class _PrintVersion(argparse.Action):
    """Prints the version; looks it up only then, because that reads the disk."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"drake-srg {importlib.metadata.version('drake_srg')}")
        parser.exit()


@command(
    "print a script that completes commands in a shell",
    'In bash: eval "$(drake-srg completion bash)". In zsh, write it to a file '
    "`_drake-srg` on the `fpath`; in fish, to "
    "~/.config/fish/completions/drake-srg.fish.",
    argument("shell", choices=SHELLS, help="which one"),
)
def completion(options: argparse.Namespace) -> int:
    """Print the script that completes `drake-srg` in a shell.

    It completes commands, options, scenarios, formats and paths.
    """
    shtab = require("shtab", "", "Completion needs")
    parser = make_parser()
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
            for each in action.choices.values():
                yield from _actions(each)


# In the order in which the overview shows them.
COMMANDS = (
    commands.run,
    commands.demo,
    cli_serve.serve,
    cli_twin.twin,
    cli_sweep.sweep,
    cli_sweep.report,
    cli_sweep.dataset,
    cli_learn.train,
    cli_learn.evaluate,
    commands.replay,
    commands.list_all,
    cli_objects.import_object,
    commands.diagram,
    commands.bench,
    command(
        "compare models and drivers with published claims and theory",
        "Exit code: 0 every claim holds, 1 at least one does not, 2 bad input.",
        cli_experiment.add_arguments,
        add_help=False,
    )(cli_experiment.experiment),
    cli_identify.identify,
    cli_calibrate.calibrate,
    cli_export.export,
    cli_new.new,
    completion,
    doctor.doctor,
)


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands; `options.run(options)` runs the chosen one."""
    parser = CommandParser(
        prog="drake-srg",
        description="Robot cells with the SAKE Robotics gripper, simulated with Drake.",
        epilog="`drake-srg COMMAND --help` describes a command and its options.",
    )
    parser.add_argument(
        "--version", action=_PrintVersion, nargs=0, help="print the version and exit"
    )
    subparsers = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND"
    )
    for each in COMMANDS:
        each.add_to(subparsers)
    return parser
