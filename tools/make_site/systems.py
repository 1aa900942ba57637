"""Every system of the package, found by its `pydrake_system` block."""

from __future__ import annotations

import ast
import dataclasses as dc
import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from drake_srg.face import names_of
from make_site.markdown import table

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "drake_srg"
DIRECTIVE = ".. pydrake_system::"


@dc.dataclass(frozen=True)
class Block:
    """A `pydrake_system` block, and the class or function that it documents."""

    module: str
    owner: str
    is_class: bool
    name: str
    summary: str
    input_ports: list[str]
    output_ports: list[str]


@functools.cache
def find_blocks() -> tuple[Block, ...]:
    """Return the block of each documented system, in the order of modules."""
    return tuple(_find_blocks())


def _find_blocks() -> Iterator[Block]:
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if DIRECTIVE not in text:
            continue
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
                document = ast.get_docstring(node) or ""
                if DIRECTIVE in document:
                    summary = " ".join(document.split("\n\n")[0].split())
                    is_class = isinstance(node, ast.ClassDef)
                    content = parse_block(document.split(DIRECTIVE, 1)[1])
                    yield Block(module, node.name, is_class, summary=summary, **content)


def parse_block(text: str) -> dict[str, Any]:
    """Return name and ports of a block, given the text behind its directive."""
    body = re.match(r"(?: *\n)*((?: +[^\n]*\n?)+)", text)
    assert body, "an empty pydrake_system block"
    ports: dict[str, Any] = {"input_ports": [], "output_ports": []}
    return ports | yaml.load(body[1], yaml.CSafeLoader)


def room_of(module: str) -> str:
    """Return the room of the package in which a module is."""
    return module.split(".")[1]


def system_pages() -> dict[str, str]:
    """Return the page of each system by its name, and of all as `index`."""
    blocks = find_blocks()
    pages = {block.name: _page(block) for block in blocks}
    rooms = dict.fromkeys(room_of(block.module) for block in blocks)
    index = [
        "# Systems\n",
        "Every system, by the room of the package that it is in. Its page shows its "
        "ports, inputs on the left and outputs on the right, and describes them. "
        "`drake-srg diagram kitchen -o kitchen.svg` draws how they are connected.\n",
    ]
    for room in rooms:
        rows = [
            (f"[{b.name}]({b.name}.md)", b.summary)
            for b in blocks
            if room_of(b.module) == room
        ]
        index += [f"## {room}\n", table(("system", ""), rows)]
    names = "\n".join(sorted(pages))
    index.append(f"```{{toctree}}\n:hidden:\n\n{names}\n```\n")
    return {"index": "\n".join(index), **pages}


def _page(block: Block) -> str:
    """Return the page of a system: its documentation, from the docstring."""
    kind = "autoclass" if block.is_class else "autofunction"
    where = f"{block.module}.{block.owner}"
    room = f"drake_srg.{room_of(block.module)}"
    public = block.owner in names_of(room)
    note = f"In full: :py:obj:`{room}.{block.owner}`.\n" if public else ""
    return (
        f"# {block.name}\n\n"
        f"```{{eval-rst}}\n.. {kind}:: {where}\n   :no-index:\n\n{note}```\n"
    )
