"""The command `drake-srg experiment`."""

import argparse
from pathlib import Path
from typing import NoReturn

from drake_srg.cli.command import SUCCESS, TASK_FAILED, Output, end_on_sigterm, writing
from drake_srg.common.exceptions import ScenarioError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments; the parser must have no help of its own."""
    parser.add_argument(
        *("-h", "--help"),
        action=_Help,
        nargs=0,
        help="show this or, after a NAME, the parameters of that experiment",
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("name", nargs="?", metavar="NAME", help="experiment to run")
    which.add_argument("--list", action="store_true", help="list the experiments")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="set a parameter of the experiment (repeatable): a name, a YAML value",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for result.json, tables and a figure "
        "(default: out/experiments/NAME)",
    )


class _Help(argparse.Action):
    """Prints the command's help or, after a NAME, that of the experiment."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option: str | None = None,
    ) -> NoReturn:
        """Print and exit."""
        from drake_srg.experiments.registry import describe

        name = getattr(namespace, "name", None)
        try:
            print(describe(name) if name else parser.format_help())
        except ScenarioError as error:
            parser.error(str(error))
        parser.exit()


def experiment(options: argparse.Namespace) -> int:
    """Run an experiment, or list all of them; returns the exit code.

    Raises:
        ScenarioError: For bad input, or if the results cannot be written.
    """
    from drake_srg.experiments.registry import REPLAY, run_experiment

    if options.list:
        _print_list(options.console)
        return SUCCESS
    out: Path = options.out or Path("out") / "experiments" / options.name
    end_on_sigterm()
    with writing("--out", out):
        result = run_experiment(
            options.name, out, overrides=options.set, progress=options.console.progress
        )
    paths = [*result.paths(options.name, out), *out.glob(REPLAY)]
    options.console.say(result.table(), "", *paths)
    rows = [row.as_dict() for row in result.rows]
    options.console.answer({"passed": result.passed, "rows": rows, "files": paths})
    return SUCCESS if result.passed else TASK_FAILED


def _print_list(output: Output) -> None:
    from drake_srg.experiments.registry import list_experiments, list_measurements

    experiments, measurements = list_experiments(), list_measurements()
    output.say(*(f"{name:24} {text}" for name, text in experiments.items()))
    if measurements:
        output.say("\nFor maintainers, in a checkout only (tools/measure):")
    output.say(*(f"{name:24} {text}" for name, text in measurements.items()))
    output.answer({"experiments": experiments, "measurements": measurements})
