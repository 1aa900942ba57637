"""README.md and docs: code runs, commands and scenarios are valid, links resolve."""

import re
import shlex
from collections import defaultdict
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from drake_srg.cli.main import make_parser
from drake_srg.robot import load_hardware
from drake_srg.scenario import load_scenario
from experiments import find_experiments

ROOT = Path(__file__).parents[1]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = {str(p.relative_to(ROOT)): p.read_text("utf-8") for p in DOCS}
PAGES["README.md"] = (ROOT / "README.md").read_text("utf-8")
HARDWARE = "docs/hardware.md"  # its YAML blocks are hardware files, or go on in one
PARTS = "arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n"
# Pages that `make docs` makes, and checks.
MADE = [ROOT / f"docs/reference/{name}/index.md" for name in ("systems", "python")]
# Whoever follows these lessons, as a test does, writes the scenarios that they run.
LESSONS = [n for n in PAGES if n.startswith("docs/tutorial/") and "index" not in n]
# Other tests run the Python of these pages, or say here why none does.
ELSEWHERE = {
    **dict.fromkeys(LESSONS, "tests/test_lessons.py"),
    "docs/experiments.md": "tests/experiments/test_pages.py",
    "docs/export.md": "tests/export/test_mjcf.py",
    "docs/dataset.md": "needs LeRobot, which is not a package of ours",
}


EXPERIMENTS: dict[str, list[str]] = defaultdict(list)  # by file
for experiment, found in find_experiments().items():
    EXPERIMENTS[found.module.rpartition(".")[2]].append(experiment)


def blocks(name, language):
    """Return the code blocks of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGES[name], re.DOTALL | re.M)


def having(language):
    return sorted(name for name in PAGES if blocks(name, language))


@pytest.fixture
def swept(tmp_path, monkeypatch):
    """A folder with the rows of a sweep, which one page reads."""
    monkeypatch.chdir(tmp_path)
    Path("out/kitchen").mkdir(parents=True)
    row = {"seed": [17], "failure": ["no_grasp"], "message": ["lost"]}
    pq.write_table(pa.table(row), "out/kitchen/trials.parquet")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "code"),
    [
        pytest.param(name, code, id=f"{name}-{i}")
        for name in having("python")
        if name not in ELSEWHERE
        for i, code in enumerate(blocks(name, "python"))
    ],
)
def test_python_blocks_run(name, code, swept):
    variables: dict = {}
    exec(compile(code, name, "exec"), variables)
    if "result" in variables:
        assert variables["result"].metrics.success


@pytest.mark.parametrize("name", sorted(ELSEWHERE))
def test_other_tests_run_the_other_blocks(name):
    test = ROOT / ELSEWHERE[name]
    assert blocks(name, "python")
    if test.suffix == ".py" and name not in LESSONS:
        assert Path(name).name in test.read_text("utf-8")


def test_some_block_replaces_a_system_of_the_cell():
    page = blocks("docs/tutorial/your_localizer.md", "python")
    assert any("make_cell=make_cell" in code for code in page)


@pytest.mark.parametrize("name", having("yaml"))
def test_scenario_blocks_are_valid(name, tmp_path):
    for text in blocks(name, "yaml"):
        path = tmp_path / "scenario.yaml"
        if name == HARDWARE or "robot.yaml" in text:
            path.write_text(text if "arm:" in text else f"{PARTS}{text}")
            load_hardware(path)
            continue
        path.write_text(text if "base:" in text else f"base: kitchen\n{text}")
        load_scenario(str(path))


def commands(name):
    """Return the commands in a page's shell blocks, without their comments."""
    lines = "".join(blocks(name, "sh")).replace("\\\n", " ").splitlines()
    return [line for line in lines if line.startswith("drake-srg ")]


@pytest.mark.parametrize(
    "name", [n for n in having("sh") if commands(n) and n not in LESSONS]
)
def test_commands_are_valid(name):
    for command in commands(name):
        words = shlex.split(command, comments=True)[1:]
        if "--help" in words:
            continue
        options = make_parser().parse_args(words)
        if "scenario" in options and isinstance(options.scenario, str):
            load_scenario(options.scenario, seed=options.seed, overrides=options.set)


def test_enough_commands_are_found():
    assert sum(len(commands(name)) for name in PAGES) > 40


def test_overrides_in_tables_are_valid():
    """The tables of `--set` values in kitchen.md belong to the scenario `kitchen`."""
    page = PAGES["docs/kitchen.md"]
    found = re.findall(r"^\| `(\S+=\S+)`", page, re.MULTILINE)
    assert len(found) >= 10
    for override in found:
        load_scenario("kitchen", overrides=[override])


def test_readme_is_one_page():
    assert len(PAGES["README.md"].splitlines()) <= 120


@pytest.mark.parametrize("name", sorted(PAGES))
def test_links_resolve(name):
    here = (ROOT / name).parent
    page = re.sub(r"```.*?```", "", PAGES[name], flags=re.DOTALL)
    for path, anchor in re.findall(r"\]\((?!http)([^)#\s]*)#?([^)\s]*)\)", page):
        target = here / path if path else ROOT / name
        assert target.exists() or target in MADE, path
        if target.suffix == ".py":  # of several experiments in a file, it names one
            assert anchor in ("", *EXPERIMENTS[target.stem]), anchor
        elif anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            assert anchor in [slug(heading) for heading in headings], anchor


def slug(heading):
    """Return the anchor that GitHub gives to a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
