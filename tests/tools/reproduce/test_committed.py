"""The committed figures, and how new ones take their place."""

import json
import re
from pathlib import Path

import pytest
from PIL import Image

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.registry import list_experiments, list_measurements
from reproduce.committed import LARGEST, Committed, read_rows
from reproduce.stamps import ROOT, hash_result
from tools.reproduce.made_rows import rows, write_stamped

OURS = Committed(ROOT / "docs")
DESCRIPTIONS = {**list_experiments(), **list_measurements()}


def test_every_experiment_has_a_committed_result():
    assert not {name for name in DESCRIPTIONS if OURS.rows(name) is None}


@pytest.mark.parametrize("name", sorted(DESCRIPTIONS))
def test_every_experiment_has_a_section_a_picture_and_its_rows(name):
    page = OURS.page.read_text()
    assert f"\n## {name}\n" in page
    assert f"(experiments/{name}.png)" in page
    assert (OURS.figures / f"{name}.png").is_file()
    assert OURS.rows(name), f"{name}: no committed result yet: make experiments"
    # Nobody wrote the numbers by hand.
    assert OURS.stamps()[name].result == hash_result(OURS.figures / f"{name}.json")


def test_the_page_is_what_the_committed_rows_give():
    assert OURS.render(DESCRIPTIONS) == OURS.page.read_text()


def test_there_are_no_results_of_other_experiments():
    names = {path.stem for path in OURS.figures.glob("*.json")} - {"stamps"}
    assert names | OURS.stamps().keys() <= DESCRIPTIONS.keys()


def test_figures_exist_and_are_small():
    figures = re.findall(r"\((experiments/[^)]+)\)", OURS.page.read_text())
    assert figures
    for figure in figures:
        assert (OURS.docs / figure).stat().st_size < LARGEST, figure


@pytest.fixture
def docs(tmp_path):
    """Docs with a page and without figures."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/experiments.md").write_text("# Page\n")
    return Committed(tmp_path / "docs")


def test_accepted_figures_are_the_committed_ones(docs, tmp_path):
    texts = {"one": "One.", "two": "Two."}
    made = {
        name: write_stamped(tmp_path / "out" / name, rows(value))
        for name, value in (("one", 1.0), ("two", 2.0))
    }
    docs.accept({"one": made["one"]}, tmp_path / "out", texts)
    assert (docs.rows("one"), docs.rows("two")) == (rows(1.0), None)
    assert docs.stamps() == {"one": made["one"]}
    page = docs.page.read_text()
    assert "## one" in page
    assert "## two" not in page
    docs.accept({"two": made["two"]}, tmp_path / "out", texts)
    assert docs.stamps() == made
    assert docs.page.read_text().startswith(page)
    assert docs.page.read_text() == docs.render(texts)
    with Image.open(docs.figures / "two.png") as picture:
        assert picture.size == (20, 10)


def test_a_page_behind_its_rows_is_noticed(docs, tmp_path):
    made = {"one": write_stamped(tmp_path / "out/one", rows(1.0))}
    docs.accept(made, tmp_path / "out", {"one": "One."})
    values = json.loads((docs.figures / "one.json").read_text())
    values[0]["measured"] = 1.5
    (docs.figures / "one.json").write_text(json.dumps(values))
    assert docs.render({"one": "One."}) != docs.page.read_text()


@pytest.mark.parametrize("content", ["[", "[1]", '[{"name": "can"}]', "3"])
def test_a_broken_result_is_named(content, tmp_path):
    path = tmp_path / "one.json"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=re.escape(f"{path}: invalid content")):
        read_rows(path)


@pytest.mark.parametrize("content", ["[", "[1]", '{"one": {}}'])
def test_broken_stamps_are_named(content, docs):
    docs.figures.mkdir()
    path: Path = docs.figures / "stamps.json"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=re.escape(f"{path}: invalid content")):
        docs.stamps()
