"""The checks of the finished site find the faults that they look for."""

import zlib

import pytest

from make_site.check import Page, inventory, link_problems, missing_names

GOOD = '<h1 id="top"><a href="b.html#there">b</a><a href="https://x.org/">x</a></h1>'


def problems(tmp_path, **pages):
    for name, text in pages.items():
        (tmp_path / f"{name}.html").write_text(text)
    found = {path: Page(path.read_text()) for path in tmp_path.glob("*.html")}
    return list(link_problems(tmp_path, found))


def test_good_links_are_no_problem(tmp_path):
    assert problems(tmp_path, a=GOOD, b='<p id="there">') == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('<a href="missing.html">', "a.html: missing.html: no such file"),
        ('<a href="b.html#nowhere">', "a.html: b.html#nowhere: no such anchor"),
        ('<img src="missing.png">', "a.html: missing.png: no such file"),
        (
            '<script src="https://cdn.org/x.js">',
            "a.html: fetches https://cdn.org/x.js",
        ),
        (
            '<link rel="stylesheet" href="//x.org/y.css">',
            "a.html: fetches //x.org/y.css",
        ),
    ],
)
def test_a_bad_link_is_found(tmp_path, text, problem):
    assert problems(tmp_path, a=text, b="<p>") == [problem]


def test_a_missing_name_is_found():
    every = missing_names([])
    assert len(every) > 200
    assert missing_names(every) == []
    assert missing_names(set(every) - {"drake_srg.simulation.Rig"}) == [
        "drake_srg.simulation.Rig"
    ]


def test_an_inventory_is_read():
    head = b"# Sphinx inventory version 2\n# Project: x\n# Version: 1\n"
    head += b"# The remainder of this file is compressed using zlib.\n"
    body = zlib.compress(b"a.b py:class 1 page.html#$ -\n")
    assert inventory(head + body) == {"a.b"}
