"""README.md: its code runs, its commands parse, its links resolve."""

import re
import shlex
from pathlib import Path

import pytest

from drake_srg.cli.main import make_parser

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
PAGES = README + (ROOT / "docs" / "bridges.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("code", BLOCKS)
def test_python_blocks_run(code):
    variables: dict = {}
    exec(compile(code, "README.md", "exec"), variables)
    if "result" in variables:
        assert variables["result"].metrics.success


def test_some_block_replaces_a_system_of_the_cell():
    assert any("make_cell=make_cell" in code for code in BLOCKS)


def test_commands_parse():
    pattern = r"^drake-srg (?:run|serve) [a-z].*?(?=\s*#|$)"
    commands = re.findall(pattern, PAGES, re.MULTILINE)
    assert len(commands) > 7
    for command in commands:
        make_parser().parse_args(shlex.split(command)[1:])


def test_links_resolve():
    links = re.findall(r"\]\((?!http)([^)#]*)(?:#([^)]+))?\)", README)
    assert links
    for path, anchor in links:
        target = ROOT / path if path else ROOT / "README.md"
        assert target.exists(), path
        if anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            assert anchor in [slug(heading) for heading in headings], anchor


def slug(heading):
    """Return the anchor that GitHub gives to a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
