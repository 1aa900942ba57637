"""Saved notebooks show what executing them shows.

Executing a notebook twice on one machine gives the same bytes. Another processor may
round differently, and software rendering may then draw an edge one pixel aside. The
tolerances allow for that, and for nothing that a reader would notice.
"""

import base64
import copy
import io
import re
import sys
from pathlib import Path

import nbformat
import numpy as np
import pytest
from PIL import Image, ImageDraw

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
# Notebooks that judge many episodes run with fewer, whose outputs are others.
SHORTENED = {"learning": ("TRIALS = 60", "TRIALS = 3")}
# A recording that no output shows has few pictures.
UNSEEN = {
    "assistive_arm": (
        "recording.video_fps=5",
        "recording={video_fps: 0.5, bag_camera_period: 2.0}",
    )
}
whole_notebooks = [path for path in NOTEBOOKS if path.stem not in SHORTENED]

NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:e[+-]?\d+)?")
# Rounding changes antialiased pixels by a few of 255 levels, and few of them by more.
# The line that a test below draws into a figure changes 0.2 % of its pixels.
LEVELS, SHARE = 24, 0.001


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import execute_notebooks

    yield execute_notebooks
    del sys.modules["execute_notebooks"]


def outputs(notebook):
    """Return the outputs in order, as (name of the kind, text or PNG)."""
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if output.get("name") == "stderr":
                continue  # warnings of a busy machine are not part of the notebook
            data = output.get("data", {"text/plain": output.get("text", "")})
            found += [(output.output_type, kind, data[kind]) for kind in sorted(data)]
    return found


def differences(saved, executed):
    """Return what a reader would notice, in words."""
    one, other = outputs(saved), outputs(executed)
    kinds = [[output[:2] for output in outputs_] for outputs_ in (one, other)]
    if kinds[0] != kinds[1]:
        return [f"kinds of output: {kinds[0]} saved, {kinds[1]} executed"]
    found = []
    for (_, kind, a), (_, _, b) in zip(one, other, strict=True):
        compare = figures_differ if kind == "image/png" else texts_differ
        found += compare(a, b)
    return found


def texts_differ(saved, executed):
    """Compare words and whole numbers exactly, decimals within their last digit."""
    words = [NUMBER.sub("#", text).split() for text in (saved, executed)]
    if words[0] != words[1]:
        return [f"text: {saved!r} saved, {executed!r} executed"]
    found = []
    for a, b in zip(NUMBER.finditer(saved), NUMBER.finditer(executed), strict=True):
        unit = 10.0 ** -len(a[1]) if a[1] else 0.0
        if abs(float(a[0]) - float(b[0])) > 1.01 * unit:
            found.append(f"number: {a[0]} saved, {b[0]} executed")
    return found


def figures_differ(saved, executed):
    """Compare the sizes, and the share of pixels that are drawn differently."""
    a, b = (np.asarray(decode(png), int) for png in (saved, executed))
    if a.shape != b.shape:
        return [f"figure: {a.shape[:2]} pixels saved, {b.shape[:2]} executed"]
    share = np.mean(np.max(np.abs(a - b), axis=2) > LEVELS)
    return [f"figure: {share:.2%} of the pixels differ"] if share > SHARE else []


def decode(png):
    return Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")


def encode(image):
    file = io.BytesIO()
    image.save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


def altered(notebook, kind, alter):
    """Return a copy of a notebook whose first output of a kind is altered."""
    changed = copy.deepcopy(notebook)
    for cell in changed.cells:
        for output in cell.get("outputs", []):
            if kind == "stream" and output.output_type == "stream":
                output.text = alter(output.text)
                return changed
            if kind in output.get("data", {}):
                output.data[kind] = alter(output.data[kind])
                return changed
    raise ValueError(f"no output of kind {kind}")


def draw(png, coordinates):
    image = decode(png)
    ImageDraw.Draw(image).line(coordinates, "black", 2)
    return encode(image)


def shift(png):
    return encode(Image.fromarray(np.roll(np.asarray(decode(png)), 1, axis=1)))


def crop(png):
    image = decode(png)
    return encode(image.crop((0, 0, image.width - 1, image.height)))


ALTERATIONS = {
    "a word": ("stream", lambda text: re.sub(r"[a-z]{4}", "else", text, count=1)),
    "a digit": (
        "stream",
        lambda text: re.sub(
            r"\.(\d)", lambda d: f".{(int(d[1]) + 5) % 10}", text, count=1
        ),
    ),
    "a line of a figure": ("image/png", lambda png: draw(png, (100, 60, 400, 200))),
    "a figure, by a pixel": ("image/png", shift),
    "a figure's size": ("image/png", crop),
}


def shortened(stem, change, folder):
    """Write a notebook with one text replaced, and return its path."""
    long, short = change
    text = (ROOT / "notebooks" / f"{stem}.ipynb").read_text("utf-8")
    assert text.count(long) == 1
    path = folder / f"{stem}.ipynb"
    path.write_text(text.replace(long, short), "utf-8")
    return path


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.slow
@pytest.mark.parametrize("stem", SHORTENED)
def test_a_shortened_notebook_shows_outputs_of_the_same_kinds(stem, tool, tmp_path):
    saved = nbformat.read(ROOT / "notebooks" / f"{stem}.ipynb", as_version=4)
    executed = outputs(tool.execute(shortened(stem, SHORTENED[stem], tmp_path)))
    kinds = [output[:2] for output in outputs(saved)]
    assert [output[:2] for output in executed] == kinds


@pytest.mark.slow
@pytest.mark.parametrize("path", whole_notebooks, ids=lambda path: path.stem)
def test_a_saved_notebook_shows_what_executing_it_shows(path, tool, tmp_path):
    saved = nbformat.read(path, as_version=4)
    if path.stem in UNSEEN:
        path = shortened(path.stem, UNSEEN[path.stem], tmp_path)
    assert differences(saved, tool.execute(path)) == []


@pytest.mark.parametrize("what", ALTERATIONS)
def test_an_altered_output_is_noticed(what):
    saved = nbformat.read(NOTEBOOKS[0], as_version=4)
    assert differences(saved, saved) == []
    assert differences(altered(saved, *ALTERATIONS[what]), saved)


def test_a_missing_output_is_noticed():
    saved = nbformat.read(NOTEBOOKS[0], as_version=4)
    other = copy.deepcopy(saved)
    next(cell for cell in other.cells if cell.get("outputs")).outputs = []
    assert differences(other, saved)


def test_rounding_is_not_noticed():
    assert texts_differ("at most 0.249, 1 grasp", "at most 0.250, 1 grasp") == []
    assert texts_differ("at most 0.249, 1 grasp", "at most 0.251, 1 grasp")
    assert texts_differ("at most 0.249, 1 grasp", "at most 0.249, 2 grasp")


@each_notebook
def test_a_saved_notebook_has_figures_and_is_small(path):
    kinds = [kind for _, kind, _ in outputs(nbformat.read(path, as_version=4))]
    assert kinds.count("image/png") >= 4
    assert path.stat().st_size < 500_000
    assert str(ROOT) not in path.read_text()
