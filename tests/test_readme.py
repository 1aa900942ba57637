"""README.md and docs: code runs, commands are valid, links resolve."""

import re
import shlex
from pathlib import Path

import pytest

from drake_srg.cli.parser import make_parser
from drake_srg.scenario import load_scenario

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
PAGES = {path.name: path.read_text() for path in (ROOT / "docs").glob("*.md")}
PAGES["README.md"] = README
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("code", BLOCKS)
def test_python_blocks_run(code):
    variables: dict = {}
    exec(compile(code, "README.md", "exec"), variables)
    if "result" in variables:
        assert variables["result"].metrics.success


def test_some_block_replaces_a_system_of_the_cell():
    assert any("make_cell=make_cell" in code for code in BLOCKS)


def commands(page):
    """Return the commands in a page's shell blocks, without their comments."""
    blocks = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [line for line in lines if line.startswith("drake-srg ")]


@pytest.mark.parametrize("name", sorted(n for n in PAGES if commands(PAGES[n])))
def test_commands_are_valid(name):
    for command in commands(PAGES[name]):
        words = shlex.split(command, comments=True)[1:]
        if "--help" in words:
            continue
        options = make_parser().parse_args(words)
        if "scenario" in options and isinstance(options.scenario, str):
            load_scenario(options.scenario, seed=options.seed, overrides=options.set)


def test_enough_commands_are_found():
    assert sum(len(commands(page)) for page in PAGES.values()) > 20


def test_overrides_in_tables_are_valid():
    """The tables of `--set` values in kitchen.md belong to the scenario `kitchen`."""
    found = re.findall(r"^\| `(\S+=\S+)`", PAGES["kitchen.md"], re.MULTILINE)
    assert len(found) >= 10
    for override in found:
        load_scenario("kitchen", overrides=[override])


@pytest.mark.parametrize("name", sorted(PAGES))
def test_links_resolve(name):
    here = ROOT if name == "README.md" else ROOT / "docs"
    page = re.sub(r"```.*?```", "", PAGES[name], flags=re.DOTALL)
    for path, anchor in re.findall(r"\]\((?!http)([^)#\s]*)#?([^)\s]*)\)", page):
        target = here / path if path else here / name
        assert target.exists(), path
        if anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            assert anchor in [slug(heading) for heading in headings], anchor


def slug(heading):
    """Return the anchor that GitHub gives to a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
