"""Sources of an experiment: the code, scenarios, models and data that its stamp hashes.

That is the experiment's module with all that it imports of ours, wherever in a file the
import stands, and the files that these name. Too much may count, but not too little.
Comments, docstrings and layout do not count, nor does what only draws.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import re
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import yaml

from experiments import FOLDER, find_experiments

ROOT = FOLDER.parent
_DRAWING = ("experiments.runner.pictures", "drake_srg.recording.timeline")
# Where the package chooses among planners: those that no scenario read has do not run.
_CHOOSING = (
    *("drake_srg.planning.planner_machine", "drake_srg.simulation.rig"),
    *("drake_srg.scenario.planner", "drake_srg.scenario.schema"),
    *("drake_srg.station.cell", "drake_srg.station.planners"),
    *("drake_srg.station.clearing", "drake_srg.station.servoing"),
)
# Starts of the names of modules that only runs with a planner need, by its tag.
_PLANNERS = {
    "Clear": ("drake_srg.planning.clearing.", "drake_srg.station.clearing"),
    "PickAndPlace": ("drake_srg.planning.pick_and_place.",),
    "Servoing": ("drake_srg.planning.servoing.", "drake_srg.station.servoing"),
    "Taught": ("drake_srg.theses.taught",),
}
_FACE = re.compile(r"^from (\S+) import \(?\s*(\w+) as \w+", re.MULTILINE)
_TEXTS = (".py", ".yaml", ".sdf", ".urdf", ".xml")
_COMMAND = ("drake_srg", "drake-srg")  # run in a process of its own: any command


def code_of(name: str) -> str:
    """Return the hash of an experiment's sources; "" if there is no such experiment."""
    found = find_experiments().get(name)
    return sources_hash(found.module) if found else ""


@functools.cache
def sources_hash(module: str, root: Path = ROOT) -> str:
    """Return a short hash of a module's sources, computed once per process."""
    whole = hashlib.sha256()
    for path in sources_of(module, root):
        name = path.relative_to(root).as_posix()
        whole.update(f"{name} {_content(path)}\n".encode())
    return whole.hexdigest()[:12]


def sources_of(module: str, root: Path = ROOT) -> list[Path]:
    """Return the files of ours that an experiment's module runs or reads, sorted."""
    own = [
        path
        for name, path in _modules(module, root, _PLANNERS).items()
        if name.startswith("experiments.") and ".runner" not in name
    ]
    names = _names(own)
    data = {
        path
        for path in (root / "experiments/data").rglob("*.*")
        if _named(path, names) and path.name != "claims.yaml"  # which pages read
    }
    names |= _names(data)
    # Whatever starts like a name may be meant: code puts `_fast` behind some.
    scenarios = root / "drake_srg/scenarios"
    read = {
        path
        for path in scenarios.glob("*.yaml")
        if any(f"{path.stem}_".startswith(f"{name.rstrip('_')}_") for name in names)
    }
    code = "".join(_text(path) for path in own)
    planners = {tag for tag in _PLANNERS if re.search(rf"\b{tag}\b", code)}
    for path in list(read):
        chain = [path]
        while base := _entry("base", chain[-1]):
            chain.append(scenarios / f"{base}.yaml")
        tags = [tag for file in chain if (tag := _entry("planner", file))]
        planners.add(tags[0] if tags else "PickAndPlace")
        read |= set(chain)
    modules = set(_modules(module, root, planners).values())
    models = {path for path in (root / "models").rglob("*.*") if path.is_file()}
    new = {*read, *data, *modules}
    names = frozenset()
    while new:
        names |= _names(new)
        new = {path for path in models - read if _named(path, names)}
        read |= new
    return sorted({*modules, *data, *read})


def _modules(module: str, root: Path, planners: Collection[str]) -> dict[str, Path]:
    """Return a module and all our modules that it imports, by name."""
    unused = tuple(
        start for tag in _PLANNERS if tag not in planners for start in _PLANNERS[tag]
    )
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _file(name, root)
        if path is None or name in found or name in _DRAWING:
            continue
        found[name] = path
        imported = _imported(name, path, root)
        if name in _CHOOSING:
            imported = [other for other in imported if not other.startswith(unused)]
        waiting += imported
    return found


@functools.cache
def _file(module: str, root: Path) -> Path | None:
    if module.partition(".")[0] not in ("drake_srg", "experiments"):
        return None
    path = root / module.replace(".", "/")
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in files if file.is_file()), None)


@functools.cache
def _imported(module: str, path: Path, root: Path) -> list[str]:
    """Return a module's imports of our modules, resolved, except for typing."""
    names = {module.rpartition(".")[0]}
    for node in _running(path):
        match node:
            case ast.Import(names=aliases):
                names |= {alias.name for alias in aliases}
            case ast.ImportFrom(module=str(home), names=aliases):
                names |= {_home(home, alias.name, root) for alias in aliases}
            case ast.Constant(value=str(text)) if text == "drake_srg.learning.envs":
                names.add(text)
            case ast.Constant(value=str(text)) if text in _COMMAND:
                if module.startswith("experiments."):
                    names.add("drake_srg.cli.main")
    return sorted(names)


@functools.cache
def _home(package: str, name: str, root: Path) -> str:
    """Return the module that `from package import name` runs."""
    if _file(f"{package}.{name}", root):
        return f"{package}.{name}"
    face = root / package.replace(".", "/") / "__init__.pyi"
    homes = _FACE.findall(face.read_text("utf-8")) if face.is_file() else []
    return next((home for home, known in homes if known == name), package)


@functools.cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def _running(path: Path) -> list[ast.AST]:
    """Return the imports and strings that run: not docstrings, nor for types alone."""
    found: list[ast.AST] = []
    waiting: list[ast.AST] = [_tree(path)]
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Import() | ast.ImportFrom():
                found.append(node)
            case ast.Constant(value):
                if isinstance(value, str):
                    found.append(node)
            case ast.Expr(value=ast.Constant(value=str())):
                pass
            case ast.If() if ast.unparse(node.test).endswith("TYPE_CHECKING"):
                waiting += node.orelse
            case _:
                for value in map(vars(node).get, node._fields):
                    if isinstance(value, ast.AST):
                        waiting.append(value)
                    elif isinstance(value, list):
                        waiting += (item for item in value if isinstance(item, ast.AST))
    return found


@functools.cache
def _content(path: Path) -> str:
    """Return a file's content without comments, docstrings and layout."""
    if path.suffix == ".py":
        return repr(_plain(_tree(path)))
    if path.suffix == ".yaml":
        text = path.read_text(encoding="utf-8")
        return repr(yaml.serialize(yaml.compose(text, yaml.CSafeLoader)))
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _plain(node: Any) -> Any:
    """Return a tree as tuples, the same with each version of Python."""
    if isinstance(node, ast.AST):
        kept = []
        for name in node._fields:
            value = _plain(getattr(node, name, None))
            if value is not None and value != []:
                kept.append((name, value))
        return type(node).__name__, kept
    if isinstance(node, list):
        return [
            _plain(item)
            for item in node
            if not (isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant))
        ]
    return node


@functools.cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.suffix in _TEXTS else ""


@functools.cache
def _names_in(path: Path) -> frozenset[str]:
    """Return the words by which a file may name others; of code, words in strings."""
    text = _text(path)
    if path.suffix == ".py":
        nodes = (n for n in _running(path) if isinstance(n, ast.Constant))
        text = "\n".join(str(node.value) for node in nodes)
    return frozenset(re.split(r"[^\w.-]+", text)) - {""}


def _names(paths: Iterable[Path]) -> frozenset[str]:
    return frozenset().union(*map(_names_in, paths))


def _named(path: Path, names: Collection[str]) -> bool:
    """Return whether names have a file, its stem or, of data, the folder of it."""
    loose = {path.stem} if path.suffix != ".obj" else {path.parent.name}
    return any(name in names for name in (path.name, *loose))


def _entry(key: str, scenario: Path) -> str:
    """Return a scenario's base, or the tag of its planner; "" if there is neither."""
    pattern = {"base": r"^base: (\w+)", "planner": r"^planner: !(\w+)"}[key]
    found = re.search(pattern, scenario.read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else ""
