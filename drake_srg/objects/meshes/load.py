"""The loader of objects' files, with its cache."""

from __future__ import annotations

import copy
import functools
import hashlib
import importlib.metadata
import json
import logging
import os
import re
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.meshes.files import (
    Contents,
    Geometry,
    MeshFile,
    read_link,
    read_xml,
)
from drake_srg.objects.sdf import DRAKE, AddContact, facet_length
from drake_srg.parsing import resolve_url

_MANIFEST = "files.json"  # SHA-256 of each file


def cache_folder() -> Path:
    """Return the folder for imported objects: below XDG_CACHE_HOME or ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "drake_srg" / "objects"


def cached_folder(key: str, make: Callable[[Path], None]) -> Path:
    """Return the folder of a key; make it if it is missing or damaged.

    It appears when it is complete, so several processes can share a cache.

    Args:
        key: Name of the folder.
        make: Fills an empty folder.

    Raises:
        ScenarioError: If the cache cannot be written.
    """
    folder = cache_folder() / key
    if _is_intact(folder):
        return folder
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=folder.parent) as there:
            new = Path(there) / key
            new.mkdir()
            make(new)
            digests = {path.name: _digest(path) for path in sorted(new.iterdir())}
            (new / _MANIFEST).write_text(json.dumps(digests), encoding="utf-8")
            if folder.exists():
                folder.rename(Path(there) / "damaged")
            try:
                new.rename(folder)
            except OSError:  # another process was faster; its folder is as good
                if not folder.is_dir():
                    raise
    except OSError as error:
        raise ScenarioError(
            f"{folder.parent}: cannot be written: {error.strerror} "
            "(set XDG_CACHE_HOME to another folder)"
        ) from None
    return folder


def copy_folder(folder: Path, to: Path) -> None:
    """Copy a folder of the cache, without what the cache added."""
    shutil.copytree(folder, to, ignore=shutil.ignore_patterns(_MANIFEST))


def _is_intact(folder: Path) -> bool:
    try:
        digests = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        return all(_digest(folder / name) == d for name, d in digests.items())
    except (OSError, ValueError, AttributeError):
        return False


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


# Changes with what `convert` makes of a file, so that old entries of the cache do not
# serve.
_VERSION = 1
_XML = (".sdf", ".urdf", ".xml")


def model_tree(name: str, config: ObjectConfig) -> ET.Element:
    """Return the SDF tree of an object's model, with one model and absolute paths.

    An SDF of primitives and declared convex meshes is taken as it is. Everything else
    is converted, once, and kept in the cache; see docs/objects.md.

    Args:
        name: The object's name, for error messages.
        config: The object.

    Returns:
        A tree that the caller may change.

    Raises:
        ScenarioError: If the file cannot be read or is broken.
        ImportError: If a mesh needs packages of the extra `import`.
    """
    try:
        path = resolve(str(config.model))
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        return copy.deepcopy(_tree(path, changed, config.scale, config.pieces))
    except ScenarioError as error:
        raise ScenarioError(f"objects.{name}.model: {error}") from None


def resolve(model: str) -> Path:
    """Return the file that a model's path or URL names.

    Raises:
        ScenarioError: If the URL's package is unknown.
    """
    if "://" not in model:
        return Path(model).expanduser().absolute()
    try:
        return resolve_url(model)
    except RuntimeError as error:
        raise ScenarioError(f"{model}: cannot be read: {one_line(error)}") from None


def import_model(path: Path, scale: float, pieces: int, *, quiet: bool = False) -> Path:
    """Return the folder in the cache with the converted model of a file.

    Args:
        path: The file.
        scale: Metres per unit of a mesh.
        pieces: Greatest number of convex pieces per mesh.
        quiet: Whether not to log what was mended.

    Raises:
        ScenarioError: If the file cannot be read or is broken.
        ImportError: If packages of the extra `import` are missing.
    """
    # Here, because SciPy takes long to import and few scenarios have such models.
    from drake_srg.objects.meshes.convert import convert, read_report

    if path.suffix.lower() in _XML:
        if scale != 1.0:
            raise ScenarioError(f"{path}: scale: must be 1, got {scale} (only meshes)")
        contents = read_link(path)
    else:
        mesh = Geometry(MeshFile(path, np.full(3, scale)))
        contents = Contents(path, [mesh], [mesh])
    key = _key([path, *contents.mesh_files()], f"{_VERSION} {scale} {pieces}")

    def make(folder: Path) -> None:
        convert(contents, pieces, folder)
        for warning in [] if quiet else read_report(folder).warnings:
            logging.getLogger("drake_srg").warning("%s: %s", path, warning)

    return cached_folder(key, make)


@functools.lru_cache(maxsize=256)
def _tree(path: Path, _changed: int, scale: float, pieces: int) -> ET.Element:
    """Return the tree of a file; `_changed` is when it was changed."""
    if path.suffix.lower() == ".sdf":
        root = read_xml(path, [])
        if root.find("model") is None:
            raise ScenarioError(f"{path}: must be an SDF file with a model")
        if scale == 1.0 and _is_convex(root):
            return _completed(root, path.parent)
    folder = import_model(path, scale, pieces)
    from drake_srg.objects.meshes.convert import MODEL  # see `import_model`

    return _completed(read_xml(folder / MODEL, []), folder)


def _is_convex(root: ET.Element) -> bool:
    """Return whether all touched meshes are declared to be convex."""
    meshes = root.findall(".//collision/geometry/mesh")
    return all(mesh.find(f"{{{DRAKE}}}declare_convex") is not None for mesh in meshes)


def _completed(root: ET.Element, folder: Path) -> ET.Element:
    """Return the tree with absolute paths and contact properties of all collisions."""
    for uri in root.iter("uri"):
        text = (uri.text or "").strip()
        if "://" not in text:
            uri.text = (folder / text).absolute().as_uri()
    for collision in root.iter("collision"):
        shapes = [shape.tag for shape in collision.findall("geometry/*")]
        known = all(tag in ("box", "cylinder", "sphere", "mesh") for tag in shapes)
        if known and collision.find(f"{{{DRAKE}}}proximity_properties") is None:
            radius = collision.findtext("geometry/*/radius")
            AddContact(collision, facet_length(float(radius)) if radius else None)
    return root


def _key(files: list[Path], options: str) -> str:
    """Return a key of the contents of files, options and the tools' versions."""
    digest = hashlib.sha256(options.encode())
    for package in ("trimesh", "coacd"):
        try:
            digest.update(importlib.metadata.version(package).encode())
        except importlib.metadata.PackageNotFoundError:
            digest.update(b"none")
    for path in _with_materials(files):
        try:
            content = path.read_bytes()
        except OSError as error:
            raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
        digest.update(path.suffix.encode() + len(content).to_bytes(8, "big") + content)
    return digest.hexdigest()[:32]


def _with_materials(files: list[Path]) -> Iterator[Path]:
    """Yield files, and those of the materials of OBJ files."""
    for path in files:
        yield path
        if path.suffix.lower() == ".obj" and path.is_file():
            names = re.findall(rb"^mtllib\s+(.+?)\s*$", path.read_bytes(), re.MULTILINE)
            for name in names:
                material = path.parent / name.decode(errors="replace")
                if material.is_file():
                    yield material
