"""The files that answer a newcomer's questions, and the files that pages name."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "how_it_is_made.md"

# For each question, the most files that may answer it, the rooms where the answer is,
# and the modules of these rooms that the answer uses without a look inside.
QUESTIONS = {
    "How does the gripper close on a can?": (7, ["gripper"], ["gripper.tendon"]),
    "Why and how does the planner retry?": (
        6,
        ["planning.pick_and_place", "planning.planner_machine"],
        ["planning.pick_and_place.sightings", "planning.pick_and_place.task_motions"],
    ),
    "How does a scenario file become a plant?": (8, ["scenario"], []),
}


def answer(question):
    """The modules that the page lists for a question, dotted below drake_srg."""
    (row,) = [line for line in PAGE.read_text("utf-8").splitlines() if question in line]
    paths = re.findall(r"`drake_srg/([a-z_/]+)\.py`", row)
    assert all((ROOT / "drake_srg" / f"{path}.py").is_file() for path in paths)
    return [path.replace("/", ".") for path in paths]


def imported(module):
    """The modules that a module imports, dotted below drake_srg."""
    path = ROOT / "drake_srg" / (module.replace(".", "/") + ".py")
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("drake_srg."):
            found.add(node.module.removeprefix("drake_srg."))
    return found


@pytest.mark.parametrize("question", QUESTIONS)
def test_few_files_answer_a_question(question):
    most, rooms, aside = QUESTIONS[question]
    modules = answer(question)
    assert 0 < len(modules) <= most
    reached = set().union(*map(imported, modules)) - set(modules) - set(aside)
    inside = tuple(f"{room}." for room in rooms)
    assert [m for m in reached if m in rooms or m.startswith(inside)] == []


# With longer steps, because the profile makes each step slow.
RUN = """
import cProfile
import sys
from drake_srg.cli.main import main

profile = cProfile.Profile(builtins=False)
profile.enable()
try:
    steps = ["--set", "plant_config.time_step=0.005", "--set", "arm.period=0.005"]
    main(["run", "kitchen", *steps, "--no-record", "--quiet", "--out", sys.argv[1]])
finally:
    profile.disable()
    codes = [entry.code for entry in profile.getstats()]
    functions = [
        c
        for c in codes
        if not isinstance(c, str) and c.co_flags & 1 and c.co_name[0] != "<"
    ]
    files = {c.co_filename for c in functions if "drake_srg" in c.co_filename}
    print(*sorted(files), sep="\\n")
"""


@pytest.mark.slow
def test_a_run_of_the_kitchen_needs_few_files(tmp_path):
    command = [sys.executable, "-c", RUN, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    files = done.stdout.splitlines()
    assert 30 < len(files) <= 90


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_name_files_that_exist(page):
    text = page.read_text("utf-8")
    paths = re.findall(
        r"\b(?:drake_srg|tests|tools|experiments)/[\w/]+\.(?:py|md)", text
    )
    assert [path for path in paths if not (ROOT / path).is_file()] == []
    modules = re.findall(r"\bfrom (drake_srg[\w.]*) import|`(drake_srg\.[\w.]+)`", text)
    names = {a or b for a, b in modules}
    assert [name for name in names if not _exists(name)] == []


def _exists(name):
    """Whether a dotted name begins with a module and names what is in it."""
    parts = name.split(".")
    for size in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:size])
        files = (path.with_suffix(".py"), path / "__init__.pyi", path / "__init__.py")
        source = next(filter(Path.is_file, files), None)
        if source is not None:
            text = source.read_text("utf-8")
            return size == len(parts) or re.search(rf"\b{parts[size]}\b", text)
    return False
