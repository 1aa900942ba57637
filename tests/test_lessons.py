"""The lessons of docs/tutorial, followed word for word, in order, in one folder."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from drake_srg.cli.main import main

FOLDER = Path(__file__).parents[1] / "docs/tutorial"
INDEX = (FOLDER / "index.md").read_text("utf-8")
LESSONS = re.findall(r"\]\((\w+)\.md\)", INDEX)
PAGES = {name: (FOLDER / f"{name}.md").read_text("utf-8") for name in LESSONS}
BLOCK = re.compile(r"^```(sh|python|yaml)\n(.*?)^```", re.DOTALL | re.M)
# A few trials and episodes show what twenty do, a recorded run of the fast cell what
# one of the accurate cell does, and a picture every two seconds what eight a second do.
SHORTER = {
    "--trials 20": "--trials 2",
    "episodes=20": "episodes=5",
    "run kitchen ": "run kitchen_fast ",
}
FEW_PICTURES = [
    *("--set", "recording.video_fps=0.5"),
    *("--set", "recording.bag_camera_period=2.0"),
]


@pytest.mark.parametrize("long", SHORTER)
def test_what_is_shortened_occurs(long):
    assert any(long in page for page in PAGES.values())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("lessons")


@pytest.mark.slow
@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_does_what_it_shows(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    page, start = PAGES[name], 0
    for match in BLOCK.finditer(page):
        language, block = match.groups()
        if language == "sh":
            for line in block.splitlines():
                follow(line)
        else:
            file = re.findall(r"\bas\s+`([\w.]+)`", page[start : match.start()])[-1]
            block = shorten(block)
            Path(file).write_text(block, "utf-8")
            if language == "python":
                assert f"`python {file}`" in page
                exec(compile(block, file, "exec"), {"__name__": "__main__"})
        start = match.end()


def shorten(text):
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return text


def follow(line):
    """Run a command; a comment names its exit codes, or an extra that it needs."""
    command, _, comment = line.partition("  # ")
    if "extra learn" in comment and not importlib.util.find_spec("torch"):
        return
    program, *words = shlex.split(shorten(command))
    assert program == "drake-srg"
    if words[0] in ("run", "sweep") and "--no-record" not in words:
        words += FEW_PICTURES
    assert str(main(words)) in (re.findall(r"\d", comment) or "0"), line


@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_has_a_small_picture_and_a_line_in_the_index(name):
    (picture,) = re.findall(r"!\[[^\]]+\]\((\w+\.webp)\)", PAGES[name])
    assert (FOLDER / picture).stat().st_size < 60_000
    assert f"({name}.md)" in INDEX


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "lifts"), [(0.05, False), (0.1, True)])
def test_a_box_with_little_friction_is_lost_as_the_lesson_says(friction, lifts):
    page = PAGES["your_object"]
    assert f"`friction={friction}`" in page
    (_, block), *_ = BLOCK.findall(page)
    code = compile(block.replace("friction=0.6", f"friction={friction}"), "box", "exec")
    if lifts:
        exec(code, {})
    else:
        with pytest.raises(AssertionError, match="something else touches the box"):
            exec(code, {})
