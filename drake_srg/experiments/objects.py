"""The household objects that experiments grasp, from objects.yaml beside this file."""

from pathlib import Path

from drake_srg.objects.config import ObjectConfig
from drake_srg.scenario.yaml_tree import load_typed, parse_yaml

_OBJECTS = Path(__file__).parent / "objects.yaml"


def household_objects() -> dict[str, ObjectConfig]:
    """Return the objects by their names, each free for the caller to change.

    Shapes are centred on their origin: a box stands on its x-y face, a cylinder on its
    end. Models stand, or lie as the wrench does, on the x-y plane of theirs.
    """
    tree = parse_yaml(_OBJECTS.read_text(encoding="utf-8"), _OBJECTS.name)
    return {
        name: load_typed(ObjectConfig, entry, f"{_OBJECTS.name}: {name}")
        for name, entry in tree.items()
    }
