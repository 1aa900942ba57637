"""Scenario files as they are written: names, bases, overrides."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from drake_srg.errors import ScenarioError
from drake_srg.yaml_loading import merge, parse_yaml, set_key

SCENARIOS = Path(__file__).parent / "scenarios"


def list_scenarios() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return sorted(path.stem for path in SCENARIOS.glob("*.yaml"))


def load_tree(name: str | Path, overrides: Iterable[str] = ()) -> dict[str, Any]:
    """Read a scenario with its bases and overrides; nothing is drawn or checked.

    Plain dicts, lists and values, which can be sent to other processes; a tag is the
    entry `_tag` of its mapping.

    Args:
        name: Name of a scenario of the package, or path of a YAML file.
        overrides: `KEY=VALUE` each; see `load_scenario`.

    Raises:
        ScenarioError: If a file cannot be read, or a key leads nowhere.
    """
    tree = _read(Path(name) if str(name).endswith(".yaml") else _builtin(name))
    for override in overrides:
        key, equals, value = override.partition("=")
        if not (key and equals):
            raise ScenarioError(f"--set {override}: must be KEY=VALUE")
        if key.split(".")[0] == "object":
            task = tree.get("task")
            picked = task.get("pick") if isinstance(task, dict) else None
            if not (picked and isinstance(picked, str)):
                raise ScenarioError(f"--set {key}: the scenario picks no object")
            key = f"objects.{picked}{key.removeprefix('object')}"
        set_key(tree, key, parse_yaml(f"value: {value}", f"--set {key}")["value"])
    return tree


def _builtin(name: str | Path) -> Path:
    if name not in list_scenarios():
        raise ScenarioError(
            f"scenario {str(name)!r} is unknown; allowed: {', '.join(list_scenarios())}"
            " or a path that ends in .yaml"
        )
    return SCENARIOS / f"{name}.yaml"


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeError:
        raise ScenarioError(f"{path}: cannot be read: not text in UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: of a null in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    tree = parse_yaml(text, path.name)
    if tree is None:
        tree = {}
    if not isinstance(tree, dict):
        raise ScenarioError(f"{path.name}: must be a mapping of keys to values")
    base = tree.pop("base", None)
    if base is None:
        return tree
    if not isinstance(base, str):
        raise ScenarioError(f"{path.name}: base: must be a scenario's name or path")
    base_path = path.parent / base if base.endswith(".yaml") else _builtin(base)
    if base_path in seen:
        raise ScenarioError(f"{path.name}: base: {base} leads back to itself")
    merged: dict[str, Any] = merge(_read(base_path, (*seen, path)), tree)
    return merged
