"""A command of the command line, with its arguments, each said once.

`command` describes the function below it; `make_parser` in `main.py` lists them all.
argparse it is: with cyclopts, typer or tyro, `--help` takes 0.15 to 0.3 s longer, and
errors take several lines.
"""

import argparse
import dataclasses as dc
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from drake_srg.scenario import Scenario

# Adds an argument, or several, to a parser or a group.
Adds: TypeAlias = Callable[[Any], object]


@dc.dataclass(frozen=True)
class Command:
    """A function that runs a command, and what the command line says of it.

    Attributes:
        run: Takes the parsed command line and returns the exit code. It raises a
            ScenarioError for bad input.
        name: As one types it.
        summary: For the overview: no capital, no full stop.
        details: What the command's own help says besides the summary.
        adds: Its arguments.
        options: More keywords of its `argparse.ArgumentParser`.
    """

    run: Callable[[argparse.Namespace], int]
    name: str
    summary: str
    details: str
    adds: tuple[Adds, ...]
    options: dict[str, Any]

    def __call__(self, options: argparse.Namespace) -> int:
        """Run the command."""
        return self.run(options)

    def add_to(self, subparsers: Any) -> None:
        """Add the command, and --json and --quiet, to a command line."""
        description = f"{self.summary[0].upper()}{self.summary[1:]}. {self.details}"
        parser = subparsers.add_parser(
            self.name,
            help=self.summary,
            description=description.strip(),
            **self.options,
        )
        parser.set_defaults(run=self.run, command=self.name)
        for add in (JSON, QUIET, *self.adds):
            add(parser)


def command(
    summary: str, details: str = "", *adds: Adds, name: str = "", **options: Any
) -> Callable[[Callable[[argparse.Namespace], int]], Command]:
    """Return a decorator that makes a command of a function; see `Command`.

    Args:
        summary: For the overview.
        details: For the command's own help, too.
        adds: Its arguments.
        name: Of the command; empty: the function's.
        options: More keywords of its parser.
    """
    return lambda run: Command(
        run, name or run.__name__, summary, details, adds, options
    )


def argument(*names: str, **options: Any) -> Adds:
    """Return what adds an argument; takes what argparse's `add_argument` does."""
    return lambda parser: parser.add_argument(*names, **options)


def flag(name: str, help: str) -> Adds:
    """Return what adds an option without a value."""
    return argument(name, action="store_true", help=help)


def one_of(*adds: Adds, required: bool = False) -> Adds:
    """Return what adds arguments of which only one may be given."""

    def add(parser: argparse.ArgumentParser) -> None:
        group = parser.add_mutually_exclusive_group(required=required)
        for each in adds:
            each(group)

    return add


def all_of(*adds: Adds) -> Adds:
    """Return what adds several arguments."""

    def add(parser: argparse.ArgumentParser) -> None:
        for each in adds:
            each(parser)

    return add


def repeatable(name: str, metavar: str, help: str) -> Adds:
    """Return what adds an option that may be given several times."""
    return argument(name, action="append", default=[], metavar=metavar, help=help)


def folder(help: str, default: Path | None = None) -> Adds:
    """Return what adds `--out`."""
    return argument("--out", type=Path, metavar="DIR", default=default, help=help)


JSON = flag("--json", "print one JSON object on standard output, also for an error")
QUIET = argument(
    *("-q", "--quiet"),
    action="store_true",
    help="print nothing but errors, warnings and what --json asks for",
)


def a_scenario(
    nargs: str | None = None,
    help: str = "a name from `drake-srg list` or a .yaml file",
) -> Adds:
    """Return what adds a scenario, its seed and overrides of its entries."""
    return all_of(
        argument("scenario", nargs=nargs, metavar="SCENARIO", help=help),
        argument(
            "--seed", type=int, metavar="N", help="replaces the scenario's random_seed"
        ),
        repeatable(
            "--set",
            "KEY=VALUE",
            "override an entry of the scenario (repeatable): a dotted key, a YAML "
            "value; `object.` stands for the picked object",
        ),
    )


SCENARIO = a_scenario()


def load(options: argparse.Namespace) -> "Scenario":
    """Return the scenario that a command's options choose; imports Drake."""
    from drake_srg.scenario import load_scenario

    return load_scenario(options.scenario, seed=options.seed, overrides=options.set)


OPEN = flag("--open", "show the page in the default browser")


def ros(ros1: str, ros2: str, peer: str) -> Adds:
    """Return what adds the options of a command that speaks ROS.

    Args:
        ros1: Help of `--ros1`.
        ros2: Help of `--ros2`.
        peer: For whom this machine's address is.
    """
    return all_of(
        flag("--ros1", ros1),
        argument(
            "--master", metavar="URI", help="ROS 1 master (default: $ROS_MASTER_URI)"
        ),
        flag("--ros2", ros2),
        argument(
            "--domain",
            type=int,
            metavar="N",
            help="ROS 2 domain (default: $ROS_DOMAIN_ID)",
        ),
        argument(
            "--host",
            default="127.0.0.1",
            metavar="ADDRESS",
            help=f"this machine's address for {peer} (default: %(default)s)",
        ),
    )


def speaks_ros(options: argparse.Namespace) -> tuple[bool, bool]:
    """Return whether a command is to speak ROS 1, and ROS 2."""
    return (
        options.ros1 or options.master is not None,
        options.ros2 or options.domain is not None,
    )
