"""The command `drake-srg experiment`: runs the experiments of a checkout."""

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any, NoReturn

from drake_srg.cli.command import (
    SUCCESS,
    TASK_FAILED,
    argument,
    command,
    flag,
    one_of,
    printing,
    repeatable,
)
from drake_srg.cli.results import results_folder
from drake_srg.common.exceptions import ScenarioError

_CHECKOUT = Path(__file__).resolve().parents[2]


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
        name = getattr(namespace, "experiment", None)
        try:
            text = _load("runner.run").describe(name) if name else parser.format_help()
            with printing():
                print(text)
        except ScenarioError as error:
            parser.error(str(error))
        parser.exit()


def _load(module: str) -> Any:
    """Import a module of experiments/, which only a checkout of the repository has.

    Raises:
        ScenarioError: If this is not a checkout.
    """
    if not (_CHECKOUT / "experiments/runner").is_dir():
        raise ScenarioError(
            "experiments are in the repository, not in the installed package: "
            "clone it and run the command there"
        )
    if str(_CHECKOUT) not in sys.path:
        sys.path.append(str(_CHECKOUT))  # workers inherit the path
    return importlib.import_module(f"experiments.{module}".removesuffix("."))


@command(
    "compare models with published claims and theory",
    "It continues earlier runs of the same experiment. Exit code: 0 every claim "
    "holds, 1 at least one does not, 2 bad input.",
    argument(
        *("-h", "--help"),
        action=_Help,
        nargs=0,
        help="print this help or, after NAME, the experiment's parameters",
    ),
    one_of(
        argument("experiment", nargs="?", metavar="NAME", help="the experiment to run"),
        flag("--list", "list the experiments"),
        required=True,
    ),
    repeatable(
        "--set",
        "KEY=VALUE",
        "set a parameter of the experiment (repeatable): a name, a YAML value",
    ),
    flag("--quick", "run only one case for each value of the first axis"),
    argument(
        "--workers",
        type=int,
        default=0,
        metavar="N",
        help="number of processes that run trials (default: one per core)",
    ),
    flag(
        "--any-code",
        "use finished trials of earlier runs even if the code has changed",
    ),
    argument(
        *("-o", "--out"),
        type=Path,
        metavar="DIR",
        help="folder for result.json, tables and a figure "
        "(default: out/experiments/NAME)",
    ),
    own_help=True,
)
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
    run = _load("runner.run")
    default = Path("out") / "experiments" / options.experiment
    with results_folder(options, default, ()) as out:  # earlier results are continued
        result = run.run_experiment(
            options.experiment,
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
