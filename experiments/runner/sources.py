"""Sources of an experiment: the code, scenarios, models and data that its stamp hashes.

That is the experiment's module with all that it imports of ours, wherever in a file the
import stands, the scenarios that it may name, all models and all data. Too much may
count, but not too little. Comments, docstrings and layout do not count, nor does what
only draws.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import re
from pathlib import Path
from typing import Any

import yaml

from experiments import FOLDER, find_experiments

ROOT = FOLDER.parent
_DRAWING = ("experiments.runner.pictures", "drake_srg.recording.timeline")
_FACE = re.compile(r"^from (\S+) import \(?\s*(\w+) as \w+", re.MULTILINE)
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
    modules = _modules(module, root)
    own = {path for name, path in modules.items() if name.startswith("experiments.")}
    named = "\n".join(str(n.value) for path in own for n in _strings(path))
    # Whatever starts like a name may be meant: code puts `_fast` behind some.
    scenarios = root / "drake_srg/scenarios"
    read = {
        path
        for path in scenarios.glob("*.yaml")
        if any(f"{path.stem}_".startswith(f"{name}_") for name in _WORD.findall(named))
    }
    for path in list(read):
        chain = [path]
        while base := _BASE.search(chain[-1].read_text(encoding="utf-8")):
            chain.append(scenarios / f"{base[1]}.yaml")
        read |= set(chain)
    data = {*(root / "experiments/data").rglob("*.*"), *(root / "models").rglob("*.*")}
    pages = ("claims.yaml", "figures.md", "readme.md")  # which only pages read
    data = {p for p in data if p.is_file() and p.name not in pages}
    return sorted({*modules.values(), *read, *data})


_WORD, _BASE = re.compile(r"\w+"), re.compile(r"^base: (\w+)", re.MULTILINE)


def _modules(module: str, root: Path) -> dict[str, Path]:
    """Return a module and all our modules that it imports, by name."""
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _file(name, root)
        if path is not None and name not in found and name not in _DRAWING:
            found[name] = path
            waiting += _imported(name, path, root)
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
def _running(path: Path) -> list[ast.AST]:
    """Return the nodes that run: not docstrings, nor imports for types alone."""
    found: list[ast.AST] = []
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                continue
            case ast.If() if ast.unparse(node.test).endswith("TYPE_CHECKING"):
                waiting += node.orelse
                continue
        found.append(node)
        waiting += ast.iter_child_nodes(node)
    return found


def _strings(path: Path) -> list[ast.Constant]:
    nodes = (node for node in _running(path) if isinstance(node, ast.Constant))
    return [node for node in nodes if isinstance(node.value, str)]


@functools.cache
def _content(path: Path) -> str:
    """Return a file's content without comments, docstrings and layout."""
    if path.suffix == ".py":
        return repr(_plain(ast.parse(path.read_text(encoding="utf-8"))))
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
