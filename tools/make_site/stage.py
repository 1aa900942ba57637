"""Puts the sources of the site together: pages of docs, README, generated ones."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from experiments.runner.page import claims_table, index, pages
from make_site.commands import commands_page
from make_site.files import log_table, metrics_table, topics_table
from make_site.gallery import figures
from make_site.keys import keys_index, keys_pages
from make_site.lists import objects_table, scenarios_table
from make_site.notebooks import notebook_page
from make_site.python_pages import python_pages
from make_site.rules import rules_page
from make_site.states import states_page
from make_site.systems import ROOT, system_pages

# What a line `<!-- generated: NAME -->` of a page stands for.
GENERATED: Mapping[str, Callable[[], str]] = {
    "readme": lambda: (ROOT / "README.md").read_text("utf-8"),
    "scenario keys": keys_index,
    "scenario rules": rules_page,
    "states": states_page,
    "commands": commands_page,
    "figures": figures,
    "experiments": index,
    "claims": claims_table,
    "log": log_table,
    "metrics": metrics_table,
    "topics": topics_table,
    "scenarios": scenarios_table,
    "objects": objects_table,
}
_MARKER = re.compile(r"^<!-- generated: ([\w ]+) -->$", re.MULTILINE)
_CONTENTS = "<!-- generated: contents -->"


def stage(folder: Path) -> None:
    """Write the sources of the site to a folder.

    Raises:
        KeyError: If a page asks for something unknown.
    """
    shutil.rmtree(folder, ignore_errors=True)
    skipped = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "docs", folder, ignore=skipped)
    shutil.copytree(ROOT / "examples", folder / "examples", ignore=skipped)
    for name, text in pages().items():
        (folder / f"experiments/{name}.md").write_text(text, "utf-8")
    write(folder / "reference/systems", system_pages(), ".md")
    write(folder / "reference/python", python_pages(), ".rst")
    write(folder / "reference/keys", keys_pages(), ".md")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        page = folder / "notebooks" / f"{path.stem}.md"
        page.parent.mkdir(exist_ok=True)
        page.write_text(notebook_page(path, page.parent / "images"), "utf-8")
    for page in sorted(folder.rglob("*.md")):
        depth = len(page.relative_to(folder).parts) - 1
        text = page.read_text("utf-8")
        text = text.replace(_CONTENTS, contents(text))
        text = _MARKER.sub(lambda m: GENERATED[m[1]](), text)
        page.write_text(relink(text, depth), "utf-8")


def contents(text: str) -> str:
    """Return the table of contents of an index: the pages that its lists link to.

    Args:
        text: Text of the index. Lists, and first columns of tables, may link to pages.
    """
    lists = re.findall(r"^\* .*(?:\n +.*)*|^\| \[[^|]*", text, re.MULTILINE)
    links = re.findall(r"\]\(([\w./]+)\.(?:md|ipynb)\)", "\n".join(lists))
    entries = [link.replace("../../notebooks/", "../notebooks/") for link in links]
    return "\n".join(("```{toctree}", ":hidden:", "", *entries, "```"))


def update(folder: Path, staged: Path) -> None:
    """Move the changed files to a folder, so that Sphinx reads only these again."""
    new = {path.relative_to(staged) for path in staged.rglob("*") if path.is_file()}
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        if path.relative_to(folder) not in new:
            path.unlink()
    for name in new:
        if not _same(staged / name, folder / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (staged / name).replace(folder / name)
    shutil.rmtree(staged)


def _same(one: Path, other: Path) -> bool:
    return other.is_file() and one.read_bytes() == other.read_bytes()


def write(folder: Path, pages: Mapping[str, str], suffix: str) -> None:
    """Write pages by their names; the index is Markdown."""
    folder.mkdir(parents=True)
    for name, text in pages.items():
        path = folder / f"{name}{'.md' if name == 'index' else suffix}"
        path.write_text(text, encoding="utf-8")


def relink(text: str, depth: int) -> str:
    """Return a page whose links to files of the repository lead to pages of the site.

    Args:
        text: Text of the page.
        depth: Folders between the page and the top of the site.
    """
    top = "../" * depth
    for pattern, new in (
        (rf"\]\({top}\.\./README\.md", rf"]({top}index.md"),
        (r"\]\(docs/", "]("),  # in README
        (r"\]\(\.\./docs/", "](../"),  # in notebooks
        (r"\]\(notebooks/([\w]+)\.ipynb", r"](notebooks/\1.md"),  # in README
        (rf"\]\({top}\.\./notebooks/(\w+)\.ipynb", rf"]({top}notebooks/\1.md"),
        # The notebook of the arm shows the replay that it has recorded.
        (r'src="out/(\w+)/replay\.html', rf'src="{top}replays/\1.html'),
        (rf"\]\({top}\.\./examples/", rf"]({top}examples/"),
        (rf"literalinclude\}} {top}\.\./", rf"literalinclude}} {top}"),
    ):
        text = re.sub(pattern, new, text)

    def experiment(match: re.Match[str]) -> str:
        return f"]({top}experiments/{match[2] or match[1]}.md"

    # Of several experiments in a file, an anchor names one.
    text = re.sub(r"\]\((?:\.\./)*experiments/(\w+)\.py(?:#(\w+))?", experiment, text)

    def module(match: re.Match[str]) -> str:
        name = match[2].removesuffix(".py").replace("/", ".")
        return f"{{py:mod}}`{match[1].strip('`')} <{name}>`"

    return re.sub(r"\[([^\]]+)\]\((?:\.\./)*(drake_srg/[\w/]+\.py)\)", module, text)
