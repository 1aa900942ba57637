"""The command `drake-srg experiment`: runs what experiments/ of a checkout claims."""

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any, NoReturn

from drake_srg.cli.command import SUCCESS, TASK_FAILED, end_on_sigterm, writing
from drake_srg.common.exceptions import ScenarioError

_CHECKOUT = Path(__file__).resolve().parents[2]


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
        "--quick",
        action="store_true",
        help="run only one case for each value of the first axis",
    )
    parser.add_argument(
        "--workers",
        type=int,
        default=0,
        metavar="N",
        help="processes that run trials (default: one a core)",
    )
    parser.add_argument(
        "--any-code",
        action="store_true",
        help="use finished trials of an earlier run although the code has changed",
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
        name = getattr(namespace, "name", None)
        try:
            text = _load("runner.run").describe(name) if name else parser.format_help()
            print(text)
        except ScenarioError as error:
            parser.error(str(error))
        parser.exit()


def _load(module: str) -> Any:
    """Import a module of experiments/, which is beside the package in a checkout.

    Raises:
        ScenarioError: If this is no checkout.
    """
    if not (_CHECKOUT / "experiments/runner").is_dir():
        raise ScenarioError(
            "experiments are in the repository, not in the installed package: "
            "clone it and run the command there"
        )
    if str(_CHECKOUT) not in sys.path:
        sys.path.append(str(_CHECKOUT))  # workers inherit the path
    return importlib.import_module(f"experiments.{module}".removesuffix("."))


def experiment(options: argparse.Namespace) -> int:
    """Run an experiment, or list all of them; returns the exit code.

    Raises:
        ScenarioError: For bad input, or if the results cannot be written.
    """
    console = options.console
    if options.list:
        found = _load("").find_experiments()
        descriptions = {name: entry.description for name, entry in found.items()}
        console.say(*(f"{name:24} {text}" for name, text in descriptions.items()))
        console.answer({"experiments": descriptions})
        return SUCCESS
    out: Path = options.out or Path("out") / "experiments" / options.name
    end_on_sigterm()
    run = _load("runner.run")
    with writing("--out", out):
        result = run.run_experiment(
            options.name,
            out,
            overrides=options.set,
            quick=options.quick,
            workers=options.workers,
            any_code=options.any_code,
            progress=console.progress,
        )
    console.say(result.table(), "", *result.files)
    rows = [row.as_dict() for row in result.rows]
    console.answer({"passed": result.passed, "rows": rows, "files": result.files})
    return SUCCESS if result.passed else TASK_FAILED
