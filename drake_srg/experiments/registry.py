"""Finds experiments by name and runs them.

An experiment is a file in this folder with a function `run(track, *, ...)`. It is named
after the file and described by the first line of the file's docstring. A file that
offers several experiments declares them instead:

    EXPERIMENTS = {"payload_wrap": ("Description.", {"grip": "wrap"}), ...}

Each entry is a description and the values that this name gives to parameters of `run`.

The keyword arguments of `run` are the parameters that `--set KEY=VALUE` changes; their
defaults (literals) and their `Args:` entries are what `--help` shows. All of this is
read from the source without importing it, so the list and the help appear at once.

Experiments for maintainers are in tools/measure, beside the package: a checkout has
them, a wheel does not.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses as dc
import functools
import importlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drake_srg import experiments
from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.common.status_line import StatusLine
from drake_srg.experiments.parameters import (
    Parameter,
    parse_values,
    read_parameters,
    split_overrides,
)

if TYPE_CHECKING:
    from drake_srg.experiments.result import ExperimentResult

T = TypeVar("T")

# Beside the results, where an experiment runs a cell: its first run.
REPLAY = "replay.html"

# The experiments in tools/measure, so that a wheel can say why it lacks them.
MEASUREMENTS = (
    "hardware_loop",
    "recording_cost",
    "sweep_throughput",
    "time_parameterization",
)
_TOOLS = Path(__file__).resolve().parents[2] / "tools"


class Track(Protocol):
    """Passes cases through and shows the progress of an experiment."""

    def __call__(
        self, cases: Sequence[T], label: Callable[[T], str] = str
    ) -> Iterator[T]:
        """Iterate over the cases.

        Args:
            cases: The cases of the experiment, of any type.
            label: Returns the text to show while a case runs.
        """


@dc.dataclass(frozen=True)
class Experiment:
    """An experiment and the file that it is in.

    Attributes:
        module: Full name of the module.
        description: One line.
        preset: Values that the experiment's name gives to parameters.
        parameters: By name; defaults include the preset.
    """

    module: str
    description: str
    preset: Mapping[str, Any]
    parameters: Mapping[str, Parameter]


def find_experiments() -> dict[str, Experiment]:
    """Return every experiment in the package by name, in order."""
    return _find(experiments.__name__, experiments.__path__)


def find_measurements() -> dict[str, Experiment]:
    """Return every experiment in tools/measure; none where there is no checkout."""
    return _find("measure", [_TOOLS / "measure"])


def list_experiments() -> dict[str, str]:
    """Return the description of every experiment in the package by name, in order."""
    return {name: found.description for name, found in find_experiments().items()}


def list_measurements() -> dict[str, str]:
    """Return the same for tools/measure; nothing where there is no checkout."""
    return {name: found.description for name, found in find_measurements().items()}


def _find(package: str, folders: Iterable[str | Path]) -> dict[str, Experiment]:
    found = {}
    for folder in folders:
        for path in Path(folder).glob("*.py"):
            found.update(_read(package, path, path.stat().st_mtime_ns))
    return dict(sorted(found.items()))


@functools.cache
def _read(package: str, path: Path, changed: int) -> dict[str, Experiment]:
    """Return the experiments of a file; most files have one or none.

    Args:
        package: The package that the file belongs to.
        path: The file.
        changed: When it was changed, so that a file is read once [ns].
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = {n.name: n for n in tree.body if isinstance(n, ast.FunctionDef)}
    if "run" not in functions:
        return {}
    own = (ast.get_docstring(tree) or "").partition("\n")[0]
    declared: dict[str, tuple[str, dict[str, Any]]] = {path.stem: (own, {})}
    for node in tree.body:
        if isinstance(node, ast.Assign) and "EXPERIMENTS" in map(
            ast.unparse, node.targets
        ):
            declared = ast.literal_eval(node.value)
    parameters = read_parameters(functions["run"])
    return {
        name: Experiment(
            f"{package}.{path.stem}",
            description,
            preset,
            {
                key: dc.replace(parameter, default=preset.get(key, parameter.default))
                for key, parameter in parameters.items()
            },
        )
        for name, (description, preset) in declared.items()
    }


def find_experiment(name: str) -> Experiment:
    """Return an experiment of the package or of tools/measure.

    Raises:
        ScenarioError: If there is no such experiment, or it needs a checkout.
    """
    found = find_experiments() | find_measurements()
    if name in found:
        return found[name]
    if name in MEASUREMENTS:
        raise ScenarioError(
            f"experiment {name!r} is in tools/measure and needs a checkout; "
            "the installed package does not contain it"
        )
    raise ScenarioError(f"unknown experiment {name!r} {suggest(name, found)}")


def describe(name: str) -> str:
    """Return an experiment's description and its parameters as text.

    Raises:
        ScenarioError: If there is no such experiment, or it needs a checkout.
    """
    experiment = find_experiment(name)
    heading = "parameters (--set KEY=VALUE):" if experiment.parameters else ""
    lines = [f"{name}: {experiment.description}", "", heading or "no parameters"]
    for key, parameter in experiment.parameters.items():
        default = parameter.default
        shown = list(default) if isinstance(default, tuple) else default
        lines.append(f"  {key}={shown}  {parameter.description}")
    return "\n".join(lines)


def run_experiment(
    name: str,
    out: Path | None = None,
    *,
    overrides: Iterable[str] = (),
    progress: bool = False,
) -> ExperimentResult:
    """Run an experiment and write its result.

    Args:
        name: A name of `list_experiments` or `list_measurements`.
        out: Folder for result.json, the tables (CSV), NAME.png and, where the
            experiment runs a cell, replay.html of its first run; None writes nothing.
        overrides: Parameters of the experiment, `KEY=VALUE` each, the value YAML.
        progress: Whether to show progress on standard error.

    Raises:
        ScenarioError: If there is no such experiment or parameter, if the experiment
            needs a checkout, if a value does not fit its parameter, or if Drake
            rejects the simulation.
        OSError: If `out` cannot be written.
        ImportError: If matplotlib is missing.
    """
    experiment = find_experiment(name)
    texts = split_overrides(name, experiment.parameters, overrides)
    from drake_srg.recording.output import output_folder, require
    from drake_srg.simulation.kept_replay import keep_first_replay

    require("matplotlib.figure")  # better now than after minutes of simulation
    if experiment.module.startswith("measure.") and str(_TOOLS) not in sys.path:
        sys.path.append(str(_TOOLS))  # workers of an experiment inherit the path
    run = importlib.import_module(experiment.module).run
    values = {**experiment.preset, **parse_values(name, run, texts)}
    track = progress_line(name) if progress else quiet
    with output_folder(out), contextlib.ExitStack() as stack:
        folder = None
        if out is not None:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix=".", dir=out)))
        with keep_first_replay(folder):
            result: ExperimentResult = run(track, **values)
        if out is not None and folder is not None:
            result.write(name, out)
            (out / REPLAY).unlink(missing_ok=True)
            if (folder / REPLAY).exists():
                (folder / REPLAY).replace(out / REPLAY)
    return result


def quiet(cases: Sequence[T], label: Callable[[T], str] = str) -> Iterator[T]:
    """Pass the cases through without showing progress: the `Track` of tests."""
    yield from cases


def progress_line(name: str) -> Track:
    """Return a `Track` that shows progress on standard error, headed by a name."""

    def track(cases: Sequence[T], label: Callable[[T], str] = str) -> Iterator[T]:
        with StatusLine() as line:
            for number, case in enumerate(cases):
                line.count(number, len(cases), f"{name}: {label(case)}")
                yield case
            line.count(len(cases), len(cases), name)

    return track
