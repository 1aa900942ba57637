"""The sources of an experiment, which its stamp hashes."""

import ast
import sys
from pathlib import Path

import pytest

from experiments import find_experiments
from experiments.runner import sources
from experiments.runner.run import find_experiment
from experiments.runner.sources import ROOT, sources_hash, sources_of

FILES = {
    "experiments/__init__.py": "",
    "experiments/claim.py": """
'''A claim.'''
import math
from typing import TYPE_CHECKING
from drake_srg.gripper import Drive
from drake_srg.station import cell
if TYPE_CHECKING:
    from drake_srg.learning import train

def trial(seed):
    '''Return the measures.'''
    from drake_srg.arm.late import measure
    return measure(Drive("bench", seed), cell)  # quick
""",
    "experiments/data/hidden.csv": "1,2",
    "drake_srg/__init__.py": "",
    "drake_srg/gripper/__init__.py": "from drake_srg.face import face",
    "drake_srg/gripper/__init__.pyi": (
        "from drake_srg.gripper.drive import Drive as Drive"
    ),
    "drake_srg/gripper/drive.py": "class Drive: pass",
    "drake_srg/gripper/wire.py": "",
    "drake_srg/arm/__init__.py": "",
    "drake_srg/arm/late.py": "measure = print",
    "drake_srg/station/__init__.py": "",
    "drake_srg/station/cell.py": "import drake_srg.planning.clearing.heap",
    "drake_srg/planning/__init__.py": "",
    "drake_srg/planning/clearing/__init__.py": "",
    "drake_srg/planning/clearing/heap.py": "",
    "drake_srg/learning/__init__.py": "",
    "drake_srg/learning/train.py": "",
    "drake_srg/scenarios/bench_fast.yaml": "base: bench\nstep: 0.01  # [s]\n",
    "drake_srg/scenarios/bench.yaml": "model: package://drake_srg/sdf/hand.sdf\n",
    "drake_srg/scenarios/kitchen.yaml": "model: none\n",
    "models/sdf/hand.sdf": "<uri>../meshes/palm.obj</uri>",
    "models/sdf/foot.sdf": "",
    "models/meshes/palm.obj": "v 0 0 0",
}
READ = {
    *("experiments/__init__.py", "experiments/claim.py", "drake_srg/__init__.py"),
    *("drake_srg/gripper/drive.py", "drake_srg/arm/__init__.py"),
    *("drake_srg/arm/late.py", "drake_srg/station/__init__.py"),
    *("drake_srg/station/cell.py", "drake_srg/scenarios/bench_fast.yaml"),
    *(
        "drake_srg/scenarios/bench.yaml",
        "models/sdf/hand.sdf",
        "models/meshes/palm.obj",
    ),
    "drake_srg/gripper/__init__.py",
}


@pytest.fixture
def tree(tmp_path):
    """Return a function that writes a small tree, with changes, into a new folder."""

    def write(**changes):
        root = tmp_path / str(len(list(tmp_path.iterdir())))
        for name, text in (FILES | changes).items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        return root

    return write


def names(root):
    return {
        p.relative_to(root).as_posix() for p in sources_of("experiments.claim", root)
    }


def test_what_is_imported_named_and_based_on_counts_and_nothing_else(tree):
    assert names(tree()) == READ


def test_a_planner_counts_with_a_scenario_that_has_it(tree):
    clears = {"drake_srg/scenarios/bench.yaml": "planner: !Clear\n"}
    assert "drake_srg/planning/clearing/heap.py" in names(tree(**clears))


def test_another_process_may_run_any_command(tree):
    called = {"experiments/claim.py": "COMMAND = ['-m', 'drake_srg']"}
    main = {"drake_srg/cli/__init__.py": "", "drake_srg/cli/main.py": ""}
    assert "drake_srg/cli/main.py" in names(tree(**called, **main))


PROSE = {
    "experiments/claim.py": FILES["experiments/claim.py"]
    .replace("A claim.", "Another text.")
    .replace("Return the measures.", "Measure.")
    .replace("# quick", "# slow")
    .replace("(seed):", "(\n    seed,\n):\n    # more"),
    "drake_srg/scenarios/bench_fast.yaml": "# Why.\nbase: bench\nstep:  0.01\n",
    "drake_srg/gripper/wire.py": "x = 1",
    "drake_srg/scenarios/kitchen.yaml": "model: other\n",
}
CODE = {
    "experiments/claim.py": FILES["experiments/claim.py"].replace("cell)", "1)"),
    "drake_srg/arm/late.py": "measure = repr",
    "drake_srg/gripper/drive.py": "class Drive:\n    slack = 'none'",
    "drake_srg/scenarios/bench_fast.yaml": "base: bench\nstep: 0.02\n",
    "models/meshes/palm.obj": "v 0 0 1",
}


@pytest.mark.parametrize("name", PROSE)
def test_prose_and_strangers_change_no_hash(tree, name):
    changed = tree(**{name: PROSE[name]})
    assert sources_hash("experiments.claim", changed) == sources_hash(
        "experiments.claim", tree()
    )


@pytest.mark.parametrize("name", CODE)
def test_code_scenarios_and_models_change_the_hash(tree, name):
    changed = tree(**{name: CODE[name]})
    assert sources_hash("experiments.claim", changed) != sources_hash(
        "experiments.claim", tree()
    )


def test_the_hash_is_the_same_with_each_python():
    """Fields that versions add to the tree are empty, and empty ones do not count."""
    plain = sources._plain(ast.parse("def f(x=None):\n    return [x, 1.5]"))
    function = ("FunctionDef", plain[1][0][1][0][1])
    assert [name for name, _ in function[1]] == ["name", "args", "body"]


@pytest.mark.parametrize(
    "name", ["servo_laws", pytest.param("closing_sequence", marks=pytest.mark.slow)]
)
def test_all_that_runs_counts(name):
    """The sources contain every caller of our functions in a trial."""
    experiment = find_experiment(name)
    case = experiment.cases(**experiment.values(name, ()))[0]
    ran = set()

    def note(frame, event, argument):
        if event == "call":
            ran.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        experiment.trial(**case)
    finally:
        sys.setprofile(None)
    ours = {Path(f) for f in ran if f.startswith((f"{ROOT}/drake_srg", f"{ROOT}/exp"))}
    drawing = {ROOT / f"{n.replace('.', '/')}.py" for n in sources._DRAWING}
    assert len(ours) > 5
    assert ours - drawing - set(sources_of(find_experiments()[name].module)) == set()
