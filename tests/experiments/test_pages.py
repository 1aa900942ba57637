"""The pages of the site, and figures elsewhere that quote results."""

import dataclasses as dc
import re
import sys
from pathlib import Path

import pytest
from made import STAMP, rows

import experiments
from experiments import find_experiments
from experiments.runner import page
from experiments.runner.committed import committed_rows
from experiments.runner.run import run_experiment
from experiments.runner.sources import code_of

ROOT = Path(__file__).parents[2]


def test_every_experiment_has_a_page():
    pages = page.pages()
    assert list(pages) == list(find_experiments())
    for name, text in pages.items():
        assert f"drake-srg experiment {name}" in text
        assert f"]({name}.png)" in text
        for row in committed_rows(name):
            assert row.quantity in text


def test_a_page_says_what_falls_short_and_what_is_stale():
    text = page.pages()["hardware"]
    assert "## What falls short" in text
    assert "lets go further than the real one" in text
    assert page.verdict("soft", rows(), STAMP) == (
        "1 of 1 claims hold. Not run since the code changed."
    )
    current = dc.replace(STAMP, sources=code_of("soft"))
    assert page.verdict("soft", rows(), current) == "1 of 1 claims hold."
    assert "**no**" in page.table(rows(5.0))


def test_claims_quote_rows_that_exist():
    for entry in page.read_claims():
        assert not set(entry["experiments"]) - set(find_experiments())
        assert "{" not in entry["ours"]
    with pytest.raises(KeyError, match="soft: no row"):
        page.fill("{soft|no|such|.1f}")
    placed = [
        r.measured for r in committed_rows("known_shapes") if r.quantity == "placed"
    ]
    assert page.fill("{known_shapes|*|placed|.3f}") == f"{min(placed):.3f}"


def test_the_index_fits_a_screen_and_has_every_experiment():
    index = page.index()
    assert len(index.splitlines()) < 80
    assert not [name for name in find_experiments() if f"/{name}.md" not in index]


@pytest.mark.parametrize("file", page.QUOTING.values(), ids=lambda file: file.name)
def test_quoted_figures_are_those_of_the_results(file):
    """`python -m experiments pages` writes them."""
    assert file.read_text(encoding="utf-8") == page.quoting_pages()[file]


def test_a_line_is_marked_if_a_result_in_it_is_of_other_code(monkeypatch):
    monkeypatch.setattr(page, "stale", lambda name, stamp: name == "singles")
    text = page.quoting_pages()[page.QUOTING["readme.md"]]
    marked = [line for line in text.splitlines() if line.endswith("† |")]
    assert len(marked) == 1
    assert "`drake-srg experiment singles`" in marked[0]


@pytest.mark.slow
def test_the_claim_that_the_docs_add_runs(tmp_path, monkeypatch):
    text = (ROOT / "docs/experiments.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(code.splitlines()) <= 60
    (tmp_path / "added_claim.py").write_text(code)
    monkeypatch.setattr(experiments, "FOLDER", tmp_path)
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(tmp_path)])
    result = run_experiment("closing_time", tmp_path / "out", workers=1)
    assert [row.name for row in result.rows] == ["0.3", "0.8"]
    assert result.passed
    sys.modules.pop("experiments.added_claim")
