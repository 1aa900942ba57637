"""How our pages are written: short sentences, plain words, short pages.

Counted is the prose of README.md, CONTRIBUTING.md and docs: paragraphs, items of lists
and cells of tables, without code blocks, headings and pictures. A full stop, a question
mark, a colon or the end of a paragraph ends a sentence, in a table also a
semicolon. Code in backquotes is one word,
and a link is its text.

The lists of exceptions only shrink: a page that needs none must not be on them.
"""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md")]
PAGES = {str(p.relative_to(ROOT)): p.read_text("utf-8") for p in sorted(FILES)}
WORDS, LINES = 25, 150
ALL_LINES = 5000  # of docs, without what `make docs` generates
# Openings and words of ours that a reader stumbles over.
BANNED = re.compile(
    r"^(What|Of|That which)\b(?!.*\?)|\bshall\b|\bis none\b|\bhas not\b|\bof which\b"
    r"|\bheld against\b|\btells of\b|\bas it does\b|\bthe way of a\b"
)
FILE_LINK = re.compile(r"\[[^\]]*\w\.(?:md|ipynb)[^\]]*\]\(")
LONG_SENTENCES: set[str] = set()
BANNED_WORDS: set[str] = set()
LINKS_BY_FILE: set[str] = set()
LONG_PAGES: set[str] = set()


def sentences(page):
    """Return the sentences of a page's prose."""
    text = re.sub(r"(?ms)^ *(`{3,}).*?^ *\1$|<!--.*?-->|^<.*?>$", "", page)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"(?s)`[^`]+`", "CODE", text)
    text = re.sub(r"(?m)^#+ .*$", "", text).replace("**", "")
    text = re.sub(r"(?m)^\|.*$", lambda row: re.sub(r"[|;]|<br>", "\n\n", row[0]), text)
    text = re.sub(r"(?m)^ *([*-]|\d+\.) ", "\n\n", text)
    for paragraph in re.split(r"\n\s*\n", text):
        yield from re.split(r"(?<=[.?:])\s+", " ".join(paragraph.split()))


def long_sentences(page):
    return [s for s in sentences(page) if len(s.split()) > WORDS]


def banned_words(page):
    return [s for s in sentences(page) if BANNED.search(s)]


def links_by_file(page):
    """Return the links that are named after a file, not after a page's title."""
    return FILE_LINK.findall(page)


def long_pages(page):
    return [f"{n} lines"] if (n := len(page.splitlines())) > LINES else []


RULES = {
    long_sentences: LONG_SENTENCES,
    banned_words: BANNED_WORDS,
    links_by_file: LINKS_BY_FILE,
    long_pages: LONG_PAGES,
}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
@pytest.mark.parametrize("name", PAGES)
def test_a_page_keeps_a_rule_or_is_an_exception(rule, name):
    found = rule(PAGES[name])
    assert bool(found) == (name in RULES[rule]), found or f"{name} needs no exception"


def test_docs_are_short():
    docs = [page for name, page in PAGES.items() if name.startswith("docs/")]
    assert sum(len(page.splitlines()) for page in docs) <= ALL_LINES


def test_exceptions_are_pages():
    assert set().union(*RULES.values()) <= set(PAGES)


def test_sentences_are_counted_as_described():
    page = "# A title\n\nOne `two three` [four](x.md).\nFive? Six: seven.\n* eight\n"
    page += "\n| a | b |\n|---|---|\n| nine. | ten<br>eleven; twelve |\n"
    assert [s for s in sentences(page) if s.strip("-")] == [
        *("One CODE four.", "Five?", "Six:", "seven.", "eight", "a", "b"),
        *("nine.", "ten", "eleven", "twelve"),
    ]
    assert long_sentences("word " * 26)
    assert not long_sentences("word " * 25)
    assert banned_words("What it does is hard.")
    assert not banned_words("What does it do?")
    assert links_by_file("| [x.md](x.md) |")
    assert not links_by_file("[X](x.md)")
