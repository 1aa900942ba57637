"""Finds experiments by name and runs them.

An experiment is a file in this folder with a function `run(track)`. Its name is the
file's, its description the first line of the file's docstring. Nothing is imported to
list them, so that the list comes at once.

Experiments for maintainers are in tools/measure, beside the package: a checkout has
them, a wheel does not.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from drake_srg import experiments
from drake_srg.common.errors import ScenarioError, suggest

if TYPE_CHECKING:
    from drake_srg.experiments.result import ExperimentResult

T = TypeVar("T")

# The experiments in tools/measure, so that a wheel can say why it lacks them.
MEASUREMENTS = ("localizer_thresholds", "recording_cost", "sweep_throughput")
_TOOLS = Path(__file__).resolve().parents[2] / "tools"


class Track(Protocol):
    """Passes cases through, and shows how far an experiment is with them."""

    def __call__(
        self, cases: Sequence[T], label: Callable[[T], str] = str
    ) -> Iterator[T]:
        """Iterate over the cases.

        Args:
            cases: Whatever the experiment goes through.
            label: What people read while a case is on.
        """


def list_experiments() -> dict[str, str]:
    """Return the description of every experiment in the package by name, in order."""
    return _descriptions(experiments.__path__)


def list_measurements() -> dict[str, str]:
    """Return the same for tools/measure; nothing where there is no checkout."""
    return _descriptions([_TOOLS / "measure"])


def _descriptions(folders: Iterable[str | Path]) -> dict[str, str]:
    found = {}
    for folder in folders:
        for path in Path(folder).glob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            functions = [n.name for n in tree.body if isinstance(n, ast.FunctionDef)]
            if "run" in functions:
                found[path.stem] = (ast.get_docstring(tree) or "").partition("\n")[0]
    return dict(sorted(found.items()))


def run_experiment(
    name: str, out: Path | None = None, *, progress: bool = False
) -> ExperimentResult:
    """Run an experiment and write what came of it.

    Args:
        name: A name of `list_experiments` or `list_measurements`.
        out: Folder for result.json, the tables (CSV) and NAME.png; None writes nothing.
        progress: Whether to show a progress bar.

    Raises:
        ScenarioError: If there is no such experiment, it needs a checkout, or Drake
            gives up on it.
        OSError: If `out` cannot be written.
        ImportError: If matplotlib is missing.
    """
    packaged, measurements = list_experiments(), list_measurements()
    if name not in packaged and name not in measurements:
        if name in MEASUREMENTS:
            raise ScenarioError(
                f"experiment {name!r} is in tools/measure and needs a checkout; "
                "the installed package does not contain it"
            )
        allowed = [*packaged, *measurements]
        raise ScenarioError(f"experiment {name!r} is unknown; {suggest(name, allowed)}")
    from drake_srg.recording.output import output_folder, require

    require("matplotlib.figure")  # better now than after minutes of simulation
    if name in packaged:
        module = importlib.import_module(f"{experiments.__name__}.{name}")
    else:
        if str(_TOOLS) not in sys.path:  # workers of an experiment inherit the path
            sys.path.append(str(_TOOLS))
        module = importlib.import_module(f"measure.{name}")
    with output_folder(out):
        result: ExperimentResult = module.run(progress_bar(name) if progress else quiet)
        if out is not None:
            result.write(name, out)
    return result


def quiet(cases: Sequence[T], label: Callable[[T], str] = str) -> Iterator[T]:
    """Pass the cases through, and say nothing: the `Track` of tests."""
    yield from cases


def progress_bar(name: str) -> Track:
    """Return a `Track` that shows a bar on standard error, headed by a name."""
    from tqdm import tqdm

    def track(cases: Sequence[T], label: Callable[[T], str] = str) -> Iterator[T]:
        style = "{desc} {bar:20} {n_fmt}/{total_fmt} [{elapsed} elapsed]"
        with tqdm(total=len(cases), file=sys.stderr, bar_format=style) as bar:
            for case in cases:
                bar.set_description_str(f"{name}: {label(case):24}")
                yield case
                bar.update()

    return track
