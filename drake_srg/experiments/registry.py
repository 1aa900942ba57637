"""Finds experiments by name and runs them.

An experiment is a file in this folder with a function `run(track)`. Its name is the
file's, its description the first line of the file's docstring. Nothing is imported to
list them, so that the list comes at once.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from drake_srg import experiments
from drake_srg.common.errors import ScenarioError, suggest

if TYPE_CHECKING:
    from drake_srg.experiments.result import ExperimentResult

T = TypeVar("T")


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
    """Return the description of every experiment by its name, in order."""
    found = {}
    for folder in experiments.__path__:
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
        name: A name of `list_experiments`.
        out: Folder for result.json, the tables (CSV) and NAME.png; None writes nothing.
        progress: Whether to show a progress bar.

    Raises:
        ScenarioError: If there is no such experiment, or Drake gives up on it.
        OSError: If `out` cannot be written.
        ImportError: If matplotlib is missing.
    """
    allowed = list_experiments()
    if name not in allowed:
        raise ScenarioError(f"experiment {name!r} is unknown; {suggest(name, allowed)}")
    from drake_srg.recording.output import output_folder, require

    require("matplotlib.figure")  # better now than after minutes of simulation
    module = importlib.import_module(f"{experiments.__name__}.{name}")
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
