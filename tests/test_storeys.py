"""Imports point downwards only; the storeys are listed here, lowest first."""

import ast
import itertools
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "drake_srg"

# Rooms on one storey never import each other.
STOREYS = [
    {"config", "face"},
    {"types", "lifetime", "parsing"},
    {"common"},
    {"arm", "gripper", "vision", "objects"},
    {"planning", "recording"},
    {"theses"},
    {"scenario"},
    {"station"},
    {"export"},
    {"simulation"},
    {"importing", "sweeps"},
    {"learning"},
    {"suite"},
    {"robot"},
    {"cli"},
    {"__init__", "__main__"},  # the face and the command
]
FLOOR = {room: i for i, rooms in enumerate(STOREYS) for room in rooms}
# Rooms with storeys of their own, lowest first.
INNER = {
    "planning": [
        *("state_machine", "motion", "planner_machine", "grasps", "task", "clearing"),
    ]
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def imports(text, name):
    """Dotted names of the modules below drake_srg that a module imports."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: imports must be absolute"
            found.add(node.module)
            # `from drake_srg import arm` imports the module drake_srg.arm.
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {m.split(".", 1)[1] for m in found if m.startswith("drake_srg.")}


def complaints(text, name):
    """Return the faults in the imports of a module, by its name below drake_srg."""
    path = name.split(".")
    wrong = []
    for target in imports(text, name):
        other = target.split(".")
        if other[0] not in FLOOR:
            continue  # a name of the face
        if other[0] != path[0]:
            if FLOOR[other[0]] >= FLOOR[path[0]]:
                wrong.append(f"{name} imports {target}")
            continue
        order = INNER.get(path[0], [])
        inner = [part[1] for part in (path, other) if part[1:] and part[1] in order]
        if inner != sorted(inner, key=order.index, reverse=True):
            wrong.append(f"{name} imports {target}")
    return wrong


def dotted(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and parts[1:] else parts)


def test_every_room_has_a_floor():
    rooms = {dotted(path).split(".")[0] for path in MODULES}
    assert rooms == FLOOR.keys()


def test_imports_point_downwards():
    wrong = [complaints(path.read_text("utf-8"), dotted(path)) for path in MODULES]
    assert list(itertools.chain(*wrong)) == []


def test_only_servoing_looks_at_images_while_it_plans():
    knowing = {
        dotted(path)
        for path in (PACKAGE / "planning").rglob("*.py")
        for name in imports(path.read_text("utf-8"), dotted(path))
        if name.split(".")[0] in {"arm", "gripper", "vision", "objects"}
    }
    assert {name.split(".")[1] for name in knowing} == {"servoing"}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("arm.driver", "from drake_srg.gripper.servo import GripperServo"),
        ("scenario.load", "import drake_srg.station.plant"),
        ("types", "from drake_srg import common"),
        ("gripper.servo", "def f():\n    from drake_srg.scenario import Scenario"),
        ("planning.motion.rrt", "from drake_srg.planning.planner_machine import X"),
        ("planning.state_machine", "from drake_srg.planning.motion.paths import X"),
    ],
)
def test_an_import_that_points_up_or_sideways_is_found(name, text):
    assert complaints(text, name) != []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("arm.driver", "from drake_srg.common.exceptions import suggest"),
        ("arm.driver", "from drake_srg.arm.external_torque import Lag"),
        ("cli.main", "from drake_srg import simulation, __version__"),
        (
            "planning.pick_and_place.modes",
            "from drake_srg.planning.motion.paths import X",
        ),
    ],
)
def test_an_import_that_points_down_is_not(name, text):
    assert complaints(text, name) == []
