"""Sphinx extension for our docstrings, in addition to autodoc.

* `pydrake_system` blocks become port pictures.
* A field of a dataclass and a constant of a module are described by their comments.
* Names in backquotes become links to what they name, if only one thing has that name.
"""

from __future__ import annotations

import functools
import sys
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.docutils import SphinxDirective

from make_site.field_comments import class_comments, module_comments
from make_site.python_pages import faces
from make_site.systems import parse_block

_OURS = "name of ours"  # a reference that `find_name` resolves


def setup(app: Sphinx) -> dict[str, bool | int]:
    """Register everything with Sphinx."""
    app.add_directive("pydrake_system", PydrakeSystem)
    app.connect("autodoc-process-docstring", describe_field)
    app.connect("doctree-read", mark_names)
    app.connect("missing-reference", find_name)
    # Sphinx reads every page again after a change to the code that makes pages.
    sources = sorted(Path(__file__).parent.glob("*.py"))
    version = zlib.crc32(b"".join(path.read_bytes() for path in sources))
    return {
        "parallel_read_safe": True,
        "parallel_write_safe": True,
        "env_version": version or 1,
    }


class PydrakeSystem(SphinxDirective):
    """Draws a system: inputs on the left, its name, outputs on the right."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the picture."""
        content = "\n".join(f" {line}" for line in self.content)
        block = parse_block(content)
        picture = nodes.container(classes=["system"])
        picture += _ports(block["input_ports"], "inputs")
        name = nodes.paragraph(classes=["system-name"])
        name += nodes.strong(text=block["name"])
        picture += name
        picture += _ports(block["output_ports"], "outputs")
        return [picture]


def _ports(ports: Iterable[str], side: str) -> nodes.Node:
    """Return the names of ports, each with its remark in brackets."""
    found = nodes.bullet_list(classes=[f"system-{side}"])
    for text in ports:
        name, _, remark = text.partition("(")
        line = nodes.paragraph()
        if name.strip():
            line += nodes.literal(text=name.strip())
        if remark:
            line += nodes.inline(text=f" ({remark.rstrip()}", classes=["port-remark"])
        item = nodes.list_item()
        item += line
        found += item
    return found


def describe_field(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Describe a field of a dataclass or a constant by its comment in the source."""
    path, _, last = name.rpartition(".")
    if what == "data" and path in sys.modules:
        home = faces().get(path, {}).get(last, path)
        comment = module_comments(home).get(last, "")
        lines[:] = [comment]  # the docstring is that of the constant's type
        return
    if what in ("attribute", "method") and not _is_documented(obj, lines):
        module, _, owner = path.rpartition(".")
        kind = getattr(sys.modules.get(module), owner, None)
        if isinstance(kind, type) and (known := class_comments(kind).get(last)):
            lines[:] = [known]


def _is_documented(obj: Any, lines: list[str]) -> bool:
    """Whether a docstring is about a member, not about the default of a field."""
    home = getattr(obj, "__module__", None) or "drake_srg"
    return any(line.strip() for line in lines) and home.startswith("drake_srg")


def mark_names(app: Sphinx, document: nodes.document) -> None:
    """Leave references to Python names to `find_name`.

    Sphinx would lead `period` to any of twenty fields of that name, or warn.
    """
    for node in document.findall(pending_xref):
        if node.get("refdomain") == "py":
            node["refdomain"], node["reftype"] = "", _OURS


def find_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Node
) -> nodes.Node | None:
    """Link a name to its target, by full name, within its module, or if unique."""
    if node.get("reftype") != _OURS:
        return None
    target = node["reftarget"].removesuffix("()")
    known = _names(env)
    for name in (target, f"{node.get('py:module')}.{target}", f"*.{target}"):
        if len(places := known.get(name, ())) == 1:
            docname, anchor = next(iter(places))
            address = app.builder.get_relative_uri(node["refdoc"], docname)
            link = nodes.reference("", "", internal=True, refuri=f"{address}#{anchor}")
            link += content
            return link
    return None


@functools.lru_cache(maxsize=1)  # asked only after all pages have been read
def _names(env: BuildEnvironment) -> dict[str, set[tuple[str, str]]]:
    """Return page and anchor by full name; as `*.NAME` those of classes and functions.

    More than one thing may be called NAME.
    """
    found: dict[str, set[tuple[str, str]]] = {}
    domain = env.domains["py"]
    for name, _, kind, docname, anchor, _ in domain.get_objects():
        found.setdefault(name, set()).add((docname, anchor))
        if kind in ("class", "function", "exception"):
            last = name.rpartition(".")[2]
            found.setdefault(f"*.{last}", set()).add((docname, anchor))
    return found
