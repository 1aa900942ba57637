"""Data for experiments: household objects and grasps, and measurements of others."""

from importlib import resources
from typing import Any

from drake_srg.objects.config import ObjectConfig
from drake_srg.scenario.typed_yaml import load_typed, parse_yaml


def household_objects() -> dict[str, ObjectConfig]:
    """Return new configs of the household objects by name; callers may change them.

    The origin of a shape is its centre: a box stands on its x-y face, a cylinder on its
    end. That of a model is on its support; the wrench lies, the other models stand.
    """
    name = "objects.yaml"
    return {
        key: load_typed(ObjectConfig, entry, f"{name}: {key}")
        for key, entry in read_yaml(name).items()
    }


def read_yaml(name: str) -> dict[str, Any]:
    """Return the tree of a YAML file in this folder."""
    tree: dict[str, Any] = parse_yaml(_read(name), name)
    return tree


def read_csv(name: str) -> list[str]:
    """Return the lines of a CSV file in this folder, without its comments."""
    return [line for line in _read(name).splitlines() if not line.startswith("#")]


def _read(name: str) -> str:
    return resources.files(__name__).joinpath(name).read_text(encoding="utf-8")
