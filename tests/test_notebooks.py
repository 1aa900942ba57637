"""The notebooks run, and show the figures that they were saved with."""

import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import execute_notebooks

    yield execute_notebooks
    del sys.modules["execute_notebooks"]


def outputs(notebook):
    """Kinds of output, by code cell."""
    return [
        [
            sorted(output.get("data", {})) or output.output_type
            for output in cell.outputs
        ]
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tool):
    saved = nbformat.read(path, as_version=4)
    assert outputs(tool.execute(path)) == outputs(saved)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_saved_notebook_shows_figures_and_is_small(path):
    figures = [
        o for cell in outputs(nbformat.read(path, 4)) for o in cell if "image/png" in o
    ]
    assert len(figures) >= 4
    assert path.stat().st_size < 500_000
    assert str(ROOT) not in path.read_text()
