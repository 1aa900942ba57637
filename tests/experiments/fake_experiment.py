"""An experiment that divides lengths."""

import sys

import pytest

from drake_srg import experiments

FAKE = '''"""Half of what was asked for.

More words.
"""
from collections.abc import Sequence
from typing import Literal

from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import make_figure

{declared}

def run(
    track,
    *,
    count: int = 2,
    lengths: Sequence[float] = (2.0, 4.0),
    kind: Literal["half", "third"] = "half",
):
    """Divide lengths.

    Args:
        track: Shows progress.
        count: How often,
            in whole numbers.
        lengths: To divide [m].
        kind: The part of a length to
            return.
    """
    parts = [length / (2 if kind == "half" else 3) for length in track(lengths)]
    if {stop}:
        raise KeyboardInterrupt
    rows = [Row.at_most(kind, f"of {{count}}", {limit}, parts[-1], "m")]
    tables = {{"parts": {{"part [m]": parts}}}}
    return ExperimentResult(rows, tables, make_figure(2, 2))
'''
TWO = """
EXPERIMENTS = {
    "fake_half": ("Half.", {}),
    "fake_third": ("A third.", {"kind": "third", "count": 3}),
}
"""


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Adds an experiment `fake_one` whose limit can be chosen."""
    folder = tmp_path / "more_experiments"
    folder.mkdir()
    (folder / "helper.py").write_text("def walk():\n    pass\n")
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(folder)])

    def write(limit, stop=False, declared=""):
        text = FAKE.format(limit=limit, stop=stop, declared=declared)
        (folder / "fake_one.py").write_text(text)
        monkeypatch.delitem(sys.modules, f"{experiments.__name__}.fake_one", False)

    yield write
    sys.modules.pop(f"{experiments.__name__}.fake_one", None)
