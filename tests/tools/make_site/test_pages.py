"""Commands, systems and public names: every one has its place in the reference."""

import inspect
import re

import pytest

import drake_srg
from drake_srg.gripper import servo
from make_site.commands import command_parsers, commands_page
from make_site.python_pages import modules, page_of, public_names, python_pages
from make_site.systems import find_blocks, system_pages


@pytest.fixture(scope="module")
def pages():
    """The pages of public names; making them imports the whole package."""
    return python_pages()


@pytest.mark.parametrize("name", sorted(command_parsers()))
def test_every_option_of_a_command_is_shown(name):
    section = commands_page().split(f"## {name}\n")[1].split("\n## ")[0]
    for action in command_parsers()[name]._actions:
        assert all(f"`{option}" in section for option in action.option_strings)
        assert action.help.split("%")[0].split("|")[0][:20] in section


def test_every_system_has_a_page():
    pages = system_pages()
    for block in find_blocks():
        assert f"{block.module}.{block.target}" in pages[block.name]
        assert f"({block.name}.md)" in pages["index"]


def test_every_public_name_is_on_a_page(pages):
    for module in modules():
        page = pages[page_of(module)]
        after = page.split(f".. automodule:: {module}\n", 1)[1]
        listed = after.splitlines()[0].removeprefix("   :members: ").split(", ")
        constants = re.findall(rf"^\.\. autodata:: {module}\.(\w+)$", page, re.M)
        assert set(public_names(module)) <= {*listed, *constants}


def test_public_names_are_those_that_python_finds():
    found = {
        name
        for name, value in vars(servo).items()
        if inspect.isclass(value) and value.__module__ == servo.__name__
    }
    # Templates are made by Drake, and named with these brackets.
    public = {name for name in found if name[0] != "_" and "𝓣" not in name}
    assert public
    assert public <= set(public_names(servo.__name__))
    assert not any(name.startswith("_") for m in modules() for name in public_names(m))


def test_the_face_leads_to_the_homes_of_its_names(pages):
    for name in set(drake_srg.__all__) - {"__version__"}:
        assert f":py:obj:`{name} <drake_srg." in pages["drake_srg"]
