"""Commands, systems and public names: every one has its place in the reference."""

import re

import pytest

import drake_srg
from drake_srg import gripper
from make_site.commands import command_parsers, commands_page
from make_site.python_pages import public_names, python_pages
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
        assert f"{block.module}.{block.owner}" in pages[block.name]
        assert f"({block.name}.md)" in pages["index"]


def test_every_public_name_is_on_the_page_of_its_face(pages):
    for name in public_names():
        face = name.rpartition(".")[0]
        page = pages[face.rpartition(".")[2]]
        assert re.search(rf"^\.\. auto(class|function|data):: {name}$", page, re.M)


def test_public_names_are_those_of_the_faces():
    shown = {name.rpartition(".")[2] for name in public_names()}
    assert {*drake_srg.__all__, *gripper.__all__} <= shown
    assert {"Blob", "Box", "Vector", "Config", "positive"} <= shown
    assert not any(name.startswith("_") for name in shown)


def test_the_names_of_the_package_lead_to_their_rooms(pages):
    for name in drake_srg.__all__:
        assert re.search(rf"\[{name}\]\(\w+\.rst\)", pages["index"])
