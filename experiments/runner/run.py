"""Finds experiments by name, runs their trials, keeps them, and writes results."""

from __future__ import annotations

import base64
import contextlib
import csv
import dataclasses as dc
import importlib
import io
import json
import math
import multiprocessing as mp
import os
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.common.status_line import StatusLine
from drake_srg.recording.output import OutputFile, output_folder
from drake_srg.recording.timeline import make_figure, save_png
from drake_srg.simulation.simulate import keep_first_replay
from experiments import find_experiments
from experiments.runner.claims import Case, Row, Trials
from experiments.runner.experiment import Experiment
from experiments.runner.sources import code_of

RESULT, KEPT = "result.json", "trials.jsonl"
# Beside the results, where an experiment runs a cell: its first run.
REPLAY = "replay.html"


def find_experiment(name: str) -> Experiment:
    """Return an experiment; it is a ScenarioError if there is none of that name."""
    found = find_experiments()
    if name not in found:
        raise ScenarioError(f"unknown experiment {name!r} {suggest(name, found)}")
    experiment = getattr(importlib.import_module(found[name].module), name)
    assert isinstance(experiment, Experiment)
    return experiment


def describe(name: str) -> str:
    """Return an experiment's description and its parameters as text."""
    experiment = find_experiment(name)
    parameters = experiment.parameters()
    lines = [f"{name}: {experiment.description}", ""]
    lines.append("parameters (--set KEY=VALUE):" if parameters else "no parameters")
    for key, (default, text) in parameters.items():
        shown = list(default) if isinstance(default, tuple) else default
        lines.append(f"  {key}={shown}  {text}")
    return "\n".join(lines)


@dc.dataclass(frozen=True)
class Result:
    """The rows of an experiment, and the files that it wrote."""

    rows: Sequence[Row]
    files: Sequence[Path] = ()

    @property
    def passed(self) -> bool:
        """Whether no row fails."""
        return not any(row.fails for row in self.rows)

    def table(self) -> str:
        """Return the rows as aligned text."""
        lines = [("", "name", "quantity", "measured", "unit", "expected")]
        for r in self.rows:
            word = "ok" if r.passed else "FAIL" if r.fails else "known"
            lines.append(
                (word, r.name, r.quantity, f"{r.measured:.4g}", r.unit, r.expected)
            )
        return align(lines)


def align(lines: Sequence[Sequence[str]]) -> str:
    """Return lines of cells as text with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def run_experiment(
    name: str,
    out: Path | None = None,
    *,
    overrides: Iterable[str] = (),
    quick: bool = False,
    workers: int = 0,
    any_code: bool = False,
    progress: bool = False,
) -> Result:
    """Run an experiment and write its result.

    Finished trials are kept in `out`, so that a run that was cut off goes on.

    Args:
        name: Name of the experiment.
        out: Folder for result.json, trials.csv, NAME.png and, where the experiment runs
            a cell, replay.html of its first run; None writes nothing.
        overrides: Parameters of the experiment, `KEY=VALUE` each, the value YAML.
        quick: Whether to run only one case for each value of the first axis.
        workers: Processes that run trials; 0 for one a core, or for one alone if the
            experiment measures wall-clock time.
        any_code: Whether kept trials of other code count, too.
        progress: Whether to show progress on standard error.

    Raises:
        ScenarioError: For an unknown experiment or a bad parameter, or if Drake rejects
            the simulation.
        OSError: If `out` cannot be written.
    """
    experiment = find_experiment(name)
    cases = list(experiment.cases(**experiment.values(name, overrides)))
    if quick:
        first = next(iter(cases[0]))
        cases = list({case[first]: case for case in reversed(cases)}.values())[::-1]
    if not workers:
        workers = 1 if experiment.serial else os.cpu_count() or 1
    with output_folder(out), contextlib.ExitStack() as stack:
        kept = Kept(out, code_of(name), any_code)
        replays = None
        if out is not None:
            replays = Path(stack.enter_context(TemporaryDirectory(prefix=".", dir=out)))
        line = stack.enter_context(StatusLine()) if progress else None
        waiting = [case for case in cases if kept.get(case) is None]
        for number, (case, result) in enumerate(
            _run_trials(name, waiting, replays, min(workers, len(waiting)))
        ):
            kept.add(case, result)
            if line:
                done = len(cases) - len(waiting) + number + 1
                line.count(done, len(cases), f"{name}: {label(case)}")
        trials = Trials([{**case, **kept.read(case)} for case in cases])
        rows = experiment.judge(trials, partial=quick)
        if out is None or replays is None:
            return Result(rows)
        return Result(rows, _write(name, experiment, trials, rows, out, replays))


def label(case: Case) -> str:
    """Return the values of a case in short."""
    return ", ".join(map(str, case.values()))[:80]


def _run_trials(
    name: str, cases: Sequence[Case], replays: Path | None, workers: int
) -> Iterator[tuple[Case, Mapping[str, Any]]]:
    """Run cases, and yield each with its encoded result when it has ended."""
    if workers <= 1:
        for i, case in enumerate(cases):
            yield case, _run_trial(name, case, None if i else replays)
        return
    context = mp.get_context("spawn")
    # Ctrl-C reaches everybody: we end the workers, which say nothing.
    ignore = (signal.SIGINT, signal.SIG_IGN)
    pool = ProcessPoolExecutor(workers, context, signal.signal, ignore)
    try:
        futures = {
            pool.submit(_run_trial, name, case, None if i else replays): case
            for i, case in enumerate(cases)
        }
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BaseException:
        for child in mp.active_children():  # a signal may have reached us alone
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _run_trial(name: str, case: Case, replays: Path | None) -> Any:
    with keep_first_replay(replays):
        return encode(dict(find_experiment(name).trial(**case)))


class Kept:
    """A file of finished trials, one line of JSON each; None keeps them in memory only.

    Trials of other code than that of the hash `code` count only if `any_code`.
    """

    def __init__(self, out: Path | None, code: str, any_code: bool = False):
        self._path, self._code = out / KEPT if out else None, code
        self._made: dict[str, Any] = {}
        if self._path is None or not self._path.exists():
            return
        for line in self._path.read_text(encoding="utf-8").splitlines():
            # A line may be incomplete; its trial then runs again.
            with contextlib.suppress(ValueError, KeyError, TypeError):
                entry = json.loads(line)
                if any_code or entry["code"] == code:
                    self._made[entry["case"]] = entry["result"]

    def get(self, case: Case) -> Any:
        """Return the encoded result of a case; None if it has not run."""
        return self._made.get(_key(case))

    def read(self, case: Case) -> dict[str, Any]:
        """Return the result of a case that has run."""
        result: dict[str, Any] = decode(self._made[_key(case)])
        return result

    def add(self, case: Case, result: Any) -> None:
        """Keep the encoded result of a case."""
        # Once through JSON, so that a kept result equals one that has just been made.
        entry = {"case": _key(case), "code": self._code, "result": result}
        text = json.dumps(entry)
        self._made[_key(case)] = json.loads(text)["result"]
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                # On a line of its own, whatever was cut off before.
                file.write(f"\n{text}\n")


def _key(case: Case) -> str:
    return json.dumps(encode(dict(case)))


def encode(value: Any) -> Any:
    """Return a value as JSON can write it; images become PNG."""
    match value:
        case np.ndarray() if value.dtype == np.uint8 and value.ndim == 3:
            file = io.BytesIO()
            Image.fromarray(value).save(file, "PNG")
            return {"png": base64.b64encode(file.getvalue()).decode()}
        case np.ndarray() | np.generic():
            return value.tolist()
        case Mapping():
            return {str(k): encode(v) for k, v in value.items()}
        case list() | tuple():
            return [encode(v) for v in value]
    return value


def decode(value: Any) -> Any:
    """Return the value that `encode` encoded; lists of numbers become arrays."""
    if isinstance(value, dict):
        if set(value) == {"png"}:
            return np.asarray(Image.open(io.BytesIO(base64.b64decode(value["png"]))))
        return {k: decode(v) for k, v in value.items()}
    if not isinstance(value, list):
        return value
    items = [decode(v) for v in value]
    numbers = all(isinstance(v, (bool, int, float, np.ndarray)) for v in items)
    if numbers and len({np.shape(v) for v in items}) <= 1:
        return np.array(items)
    return items


def _write(
    name: str,
    experiment: Experiment,
    trials: Trials,
    rows: Sequence[Row],
    out: Path,
    replays: Path,
) -> list[Path]:
    """Write result.json, trials.csv, files and NAME.png: all of them or none.

    Equal results give equal bytes.
    """
    texts = {RESULT: json.dumps([r.as_dict() for r in rows], indent=2) + "\n"}
    texts["trials.csv"] = _csv(trials)
    texts |= experiment.files(trials) if experiment.files else {}
    figure = make_figure(8.0, 4.0)
    experiment.draw(figure, trials, rows)
    with contextlib.ExitStack() as stack:
        outputs = {file: OutputFile(out / file) for file in (*texts, f"{name}.png")}
        for output in outputs.values():
            stack.callback(output.discard)
        for file, text in texts.items():
            outputs[file].path.write_text(text, encoding="utf-8")
        save_png(figure, outputs[f"{name}.png"].path)
        written = [output.commit() for output in outputs.values()]
    if (replays / REPLAY).exists():
        (replays / REPLAY).replace(out / REPLAY)
    return [*written, *out.glob(REPLAY)]


def _csv(trials: Trials) -> str:
    """Return axes and scalar measures: numbers with 9 digits, NaN as an empty field."""

    def show(value: Any) -> str:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        return f"{value:.9g}" if isinstance(value, float) else str(value)

    scalars = (str, int, float, type(None))
    columns = dict.fromkeys(
        key for t in trials for key, value in t.items() if isinstance(value, scalars)
    )
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    for t in trials:
        values = [t.get(key) for key in columns]
        writer.writerow([show(v) if isinstance(v, scalars) else "" for v in values])
    return file.getvalue()
