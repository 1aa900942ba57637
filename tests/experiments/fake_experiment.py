"""An experiment that divides lengths, in a separate folder."""

import sys

import pytest

import experiments

FAKE = '''"""Half of what was asked for.

More words.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

import experiments.runner as ex


def cases(
    count: int = 2,
    lengths: Sequence[float] = (2.0, 4.0),
    kind: Literal["half", "third"] = "half",
):
    """Divide lengths.

    Args:
        count: Number of times,
            in whole numbers.
        lengths: To divide [m].
        kind: The part of a length to
            return.
    """
    return ex.grid(kind=[kind], length=lengths, count=[count])


def trial(kind, length, count):
    with open({log!r}, "a") as file:
        file.write(f"{{length}}\\n")
    if length > {largest}:
        raise KeyboardInterrupt
    part = length / (2 if kind == "half" else 3)
    curve = np.linspace(0.0, part, 5)
    image = np.full((4, 4, 3), 7, np.uint8)
    return {{"part": part, "x": curve, "image": image, "none": None}}


def summary(own):
    assert own[0]["image"].shape == (4, 4, 3)
    return {{f"of {{own[0]['count']}} [m]": max(own["part"])}}


COMMON = {{
    "claims": {{"of 2": ex.at_most({limit}), "of 3": ex.at_most({limit})}},
    "by": ("kind",),
    "summary": summary,
    "picture": [ex.Points("length", "part"), ex.Curves("x", "x"), ex.Histogram("part"),
                ex.Images(), ex.Bars(["of 2"])],
}}
fake_half = ex.Experiment("Half.", cases, trial, **COMMON)
fake_third = ex.Experiment(
    "A third.", cases, trial, preset={{"kind": "third", "count": 3}}, **COMMON
)
'''


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Write experiments `fake_half` and `fake_third`; tell the lengths that ran."""
    folder, log = tmp_path / "more_experiments", tmp_path / "ran.txt"
    folder.mkdir()
    (folder / "helper.py").write_text("def walk():\n    pass\n")
    monkeypatch.setattr(experiments, "FOLDER", folder)
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(folder)])

    def write(limit=2.0, largest=100.0):
        text = FAKE.format(limit=limit, largest=largest, log=str(log))
        (folder / "fake.py").write_text(text)
        sys.modules.pop("experiments.fake", None)
        log.write_text("")
        return lambda: [float(line) for line in log.read_text().split()]

    yield write
    sys.modules.pop("experiments.fake", None)
