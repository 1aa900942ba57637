"""The preparation of the repository's pages for Sphinx."""

import nbformat
import pytest

from drake_srg.objects.household import HOUSEHOLD
from drake_srg.scenario import list_scenarios
from make_site import stage
from make_site.notebooks import notebook_page


@pytest.mark.parametrize(
    ("text", "depth", "new"),
    [
        ("[a](docs/x.md#y)", 0, "[a](x.md#y)"),
        ("[a](../README.md#figures)", 0, "[a](index.md#figures)"),
        ("[a](../../README.md)", 1, "[a](../index.md)"),
        ("[a](../notebooks/n.ipynb)", 0, "[a](notebooks/n.md)"),
        ("[a](../../notebooks/n.ipynb)", 1, "[a](../notebooks/n.md)"),
        ("[a](x.md)", 0, "[a](x.md)"),
        (
            "[`A`](../drake_srg/vision/a.py)",
            0,
            "{py:mod}`A <drake_srg.vision.a>`",
        ),
        (
            '<iframe src="out/arm/replay.html">',
            1,
            '<iframe src="../replays/arm.html">',
        ),
    ],
)
def test_links_to_files_lead_to_pages(text, depth, new):
    assert stage.relink(text, depth) == new


def test_only_what_has_changed_is_updated(tmp_path):
    staged, folder = tmp_path / "staged", tmp_path / "source"
    for name, old, new in (
        ("same", "1", "1"),
        ("changed", "1", "2"),
        ("gone", "1", ""),
    ):
        for place, text in ((folder, old), (staged, new)):
            if text:
                (place / "sub").mkdir(parents=True, exist_ok=True)
                (place / "sub" / name).write_text(text)
    before = (folder / "sub/same").stat().st_ino
    stage.update(folder, staged)
    assert (folder / "sub/same").stat().st_ino == before
    assert (folder / "sub/changed").read_text() == "2"
    assert not (folder / "sub/gone").exists()
    assert not staged.exists()


def test_every_marker_of_docs_is_known():
    docs = stage.ROOT / "docs"
    pages = [path.read_text("utf-8") for path in docs.rglob("*.md")]
    found = [name for page in pages for name in stage._MARKER.findall(page)]
    assert sorted(name for name in found if name != "contents") == sorted(
        stage.GENERATED
    )


def test_contents_are_the_pages_that_lists_link_to():
    index = """# Title

A [page](elsewhere.md) in a paragraph.

* [One](../one.md): a line, see [two](two.md#part).
* [Notebook](../../notebooks/n.ipynb),
  [three](sub/three.md).

| [Four](four.md) | [five](five.md) |
"""
    tree = stage.contents(index).splitlines()
    assert tree[3:-1] == ["../one", "../notebooks/n", "sub/three", "four"]


def test_every_page_is_in_one_table_of_contents():
    docs = stage.ROOT / "docs"
    found = []
    for index in docs.glob("*/index.md"):
        tree = stage.contents(index.read_text("utf-8")).splitlines()[3:-1]
        found += [(index.parent / entry).resolve() for entry in tree]
    pages = [page.with_suffix("") for page in docs.rglob("*.md")]
    listed = [page for page in pages if page.name not in ("index", "gallery")]
    assert sorted(set(found) & set(listed)) == sorted(listed)
    assert len(found) == len(set(found))


def test_lists_are_complete():
    for name in list_scenarios():
        assert f"| `{name}` |" in stage.GENERATED["scenarios"]()
    objects = stage.GENERATED["objects"]()
    assert "| `005_tomato_soup_can` | 68 x 68 x 102 | 349 | 1 |" in objects
    assert len(objects.splitlines()) == 2 + len(HOUSEHOLD)


def test_a_notebook_becomes_a_page(tmp_path):
    notebook = nbformat.v4.new_notebook()
    code = nbformat.v4.new_code_cell("print(1)")
    code.outputs = [
        nbformat.v4.new_output("stream", text="1\n"),
        nbformat.v4.new_output("display_data", data={"image/png": "iVBORw0="}),
    ]
    notebook.cells = [nbformat.v4.new_markdown_cell("# Title"), code]
    path = tmp_path / "n.ipynb"
    nbformat.write(notebook, path)
    page = notebook_page(path, tmp_path / "images")
    assert page.startswith("# Title\n\n```python\nprint(1)\n```\n\n```text\n1\n```\n\n")
    assert "![](images/n_3.png)" in page
    assert (tmp_path / "images/n_3.png").is_file()
