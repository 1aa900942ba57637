"""Checks a finished site: links, offline use, and that nothing is missing."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from make_site.commands import command_parsers
from make_site.keys import scenario_keys
from make_site.python_pages import public_names
from make_site.systems import find_blocks

# Attributes that make a browser fetch something as it opens a page.
_FETCHED = {"img": "src", "script": "src", "iframe": "src", "link": "href"}


class Page(HTMLParser):
    """The anchors of a page, the links on it, and what it fetches."""

    def __init__(self, text: str):
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what an element contributes."""
        found = dict(attrs)
        self.anchors |= {name for key in ("id", "name") if (name := found.get(key))}
        if tag == "a" and (link := found.get("href")):
            self.links.append(link)
        if (address := found.get(_FETCHED.get(tag, ""))) and not (
            tag == "link" and found.get("rel") in ("canonical", "index", "search")
        ):
            self.fetched.append(address)


def problems(site: Path) -> list[str]:
    """Return the problems of a site, in words."""
    pages = {path: Page(path.read_text("utf-8")) for path in site.rglob("*.html")}
    found = [*link_problems(site, pages)]
    names = inventory((site / "objects.inv").read_bytes())
    found += [f"no public name {name}" for name in missing_names(names)]
    reference = [site / "reference/scenario_keys.html"]
    reference += sorted((site / "reference/keys").glob("*.html"))
    keys = "".join(path.read_text("utf-8") for path in reference).replace("<wbr>", "")
    found += [
        f"no scenario key {path}"
        for path in sorted({key.path for key in scenario_keys()})
        if f">{path}<" not in re.sub(r"<span class=\"pre\">|</span>", "", keys)
    ]
    commands = pages[site / "reference/commands.html"].anchors
    found += [
        f"no command {name}" for name in command_parsers() if name not in commands
    ]
    found += [
        f"no port picture of {block.name}"
        for block in find_blocks()
        if 'class="system ' not in _text(site / f"reference/systems/{block.name}.html")
    ]
    return found


def _text(path: Path) -> str:
    return path.read_text("utf-8") if path.is_file() else ""


def link_problems(site: Path, pages: Mapping[Path, Page]) -> Iterator[str]:
    """Yield broken links, and resources that a page fetches from other hosts."""
    for path, page in sorted(pages.items()):
        where = path.relative_to(site)
        for address in page.fetched:
            if urlsplit(address).netloc:
                yield f"{where}: fetches {address}"
        for link in (*page.links, *page.fetched):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = path.parent / unquote(parts.path) if parts.path else path
            target = target.resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            if not target.is_file():
                yield f"{where}: {link}: no such file"
                continue
            anchors = pages[target].anchors if target in pages else {parts.fragment}
            if parts.fragment and unquote(parts.fragment) not in anchors:
                yield f"{where}: {link}: no such anchor"


def inventory(data: bytes) -> set[str]:
    """Return the names in a Sphinx inventory (objects.inv, version 2)."""
    header, body = data.split(b"# The remainder of this file is compressed", 1)
    assert header.startswith(b"# Sphinx inventory version 2"), header
    lines = zlib.decompress(body.split(b"\n", 1)[1]).decode("utf-8").splitlines()
    return {line.split(" ", 1)[0] for line in lines}


def missing_names(documented: Iterable[str]) -> list[str]:
    """Return the public names of the package that are not documented."""
    return sorted({*public_names()} - set(documented))
