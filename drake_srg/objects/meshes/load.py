"""The loader of objects' files, with its cache."""

from __future__ import annotations

import contextlib
import copy
import functools
import hashlib
import importlib.metadata
import json
import logging
import os
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias
from urllib.parse import unquote

import numpy as np

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.meshes.files import (
    Contents,
    Geometry,
    MeshFile,
)
from drake_srg.objects.meshes.links import is_complete, read_link, read_xml, resolved
from drake_srg.objects.meshes.sources import read_bytes, read_source
from drake_srg.objects.sdf import (
    PROXIMITY,
    AddContact,
    facet_length,
    ode_friction,
)
from drake_srg.parsing import resolve_url

_MANIFEST = "files.json"  # SHA-256 of each file


def cache_folder() -> Path:
    """Return the folder for imported objects: below XDG_CACHE_HOME or ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "drake_srg" / "objects"


def cached_folder(key: str, make: Callable[[Path], None]) -> Path:
    """Return the cache's folder for a key; make it if it is missing or damaged.

    The folder appears only when complete, so several processes can share a cache.

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
            except OSError:  # another process was faster; use its folder
                if not folder.is_dir():
                    raise
    except OSError as error:
        raise ScenarioError(
            f"{folder.parent}: cannot be written: {error.strerror} "
            "(set XDG_CACHE_HOME to another folder)"
        ) from None
    return folder


def copy_folder(folder: Path, to: Path) -> None:
    """Copy a folder of the cache, without its manifest."""
    shutil.copytree(folder, to, ignore=shutil.ignore_patterns(_MANIFEST))


def _is_intact(folder: Path) -> bool:
    try:
        digests = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        return all(_digest(folder / name) == d for name, d in digests.items())
    except (OSError, ValueError, AttributeError):
        return False


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


_XML = (".sdf", ".urdf", ".xml")


def model_tree(name: str, config: ObjectConfig) -> ET.Element:
    """Return the SDF tree of an object's model, with one model and absolute paths.

    An SDF of primitives and declared convex meshes is used unchanged. Everything else
    is converted once and kept in the cache; see docs/importing.md.

    Args:
        name: The object's name, for error messages.
        config: The object.

    Returns:
        A tree that the caller may change.

    Raises:
        ScenarioError: If the file cannot be read or is broken.
        ImportError: If a mesh needs packages of the extra `import`, and they are
            missing.
    """
    try:
        path = resolve(str(config.model))
        return copy.deepcopy(_tree(path, _stamps(path), config.scale, config.pieces))
    except ScenarioError as error:
        raise ScenarioError(f"objects.{name}.model: {error}") from None


def resolve(model: str) -> Path:
    """Return the file that a model's path or URL names.

    Raises:
        ScenarioError: If the URL's package is unknown.
    """
    if "://" not in model:
        return Path(model).expanduser().absolute()
    if model.startswith("file://"):
        plain = Path(model.removeprefix("file://"))
        return plain if plain.exists() else Path(unquote(str(plain)))
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
        quiet: Whether to leave mended defects out of the log.

    Raises:
        ScenarioError: If the file cannot be read or is broken.
        ImportError: If packages of the extra `import` are missing.
    """
    # Imported here, because SciPy takes long to import and few scenarios need it.
    from drake_srg.objects.meshes.convert import convert, read_report

    if path.suffix.lower() in _XML:
        if scale != 1.0:
            raise ScenarioError(
                f"{path}: scale: must be 1, got {scale}: give its <mesh> a scale"
            )
        contents = read_link(path)
    else:
        mesh = Geometry(MeshFile(path, np.full(3, scale)))
        contents = Contents(path, [mesh], [mesh])
    key = _key([path, *contents.mesh_files()], f"{scale} {pieces}")

    def make(folder: Path) -> None:
        convert(contents, pieces, folder)
        for warning in [] if quiet else read_report(folder).warnings:
            logging.getLogger("drake_srg").warning("%s: %s", path, warning)

    return cached_folder(key, make)


def model_files(path: Path) -> list[Path]:
    """Return all files of a model: itself, and its meshes, materials and textures.

    Missing and unreadable files are left out.
    """
    return [file for file, _, _ in _stamps(path)]


Stamps: TypeAlias = tuple[tuple[Path, int, int], ...]


def _stamps(path: Path) -> Stamps:
    """Return the files of a model, with their sizes and times of change."""
    found: dict[Path, tuple[int, int]] = {}
    waiting = [path]
    while waiting:
        file = waiting.pop()
        with contextlib.suppress(OSError, ValueError):
            stat = file.stat()
            found[file] = stat.st_mtime_ns, stat.st_size
            named = _named_files(file, *found[file])
            waiting += [other for other in named if other not in found]
    return tuple((file, *stamp) for file, stamp in found.items())


@functools.lru_cache(maxsize=256)
def _named_files(path: Path, changed: int, size: int) -> list[Path]:
    """Return the other files that the conversion of a model's file reads."""
    try:
        if path.suffix.lower() not in _XML:
            return read_source(path).neighbours
        if _taken(path, changed, size) is not None:
            return []  # Drake reads the other files each time
        return read_link(path).mesh_files()
    except ScenarioError:  # reported when it is read
        return []


@functools.lru_cache(maxsize=256)
def _taken(path: Path, _changed: int, _size: int) -> ET.Element | None:
    """Return the tree of an SDF that Drake can read; None if it needs conversion."""
    if path.suffix.lower() != ".sdf":
        return None
    root = read_xml(path, [])
    return _completed(root, path) if is_complete(path, root) else None


@functools.lru_cache(maxsize=256)
def _tree(path: Path, stamps: Stamps, scale: float, pieces: int) -> ET.Element:
    """Return the tree of a file; `stamps` is the cache's key for changed files."""
    if scale == 1.0 and stamps and (root := _taken(*stamps[0])) is not None:
        return root
    folder = import_model(path, scale, pieces)
    from drake_srg.objects.meshes.convert import MODEL  # see `import_model`

    return _completed(read_xml(folder / MODEL, []), folder / MODEL)


def _completed(root: ET.Element, path: Path) -> ET.Element:
    """Return a file's tree with absolute paths and contact properties everywhere."""
    for uri in root.iterfind(".//geometry/mesh/uri"):
        text = (uri.text or "").strip()
        if not text.startswith(_OURS):
            # Drake reads the text after `file://` literally, so escape nothing.
            uri.text = f"file://{resolved(path, text).absolute()}"
    for collision in root.iter("collision"):
        shapes = [shape.tag for shape in collision.findall("geometry/*")]
        known = all(tag in _SHAPES for tag in shapes)
        if known and collision.find(PROXIMITY) is None:
            radius = collision.findtext("geometry/*/radius")
            radii = (radius or collision.findtext("geometry/*/radii") or "").split()
            length = facet_length(min(map(float, radii))) if radii else None
            AddContact(collision, length, ode_friction(collision, path))
            for surface in collision.findall("surface"):  # Drake would warn about it
                collision.remove(surface)
    return root


_OURS = "package://drake_srg/"
_SHAPES = ("box", "capsule", "cylinder", "ellipsoid", "mesh", "sphere")


def _key(files: list[Path], options: str) -> str:
    """Return a key for the files' contents, the options and the converter's code."""
    digest = hashlib.sha256(options.encode())
    for package in ("trimesh", "coacd"):
        try:
            digest.update(importlib.metadata.version(package).encode())
        except importlib.metadata.PackageNotFoundError:
            digest.update(b"none")
    digest.update(_own_digest())
    for path in files:
        parts = [path.suffix.encode(), read_bytes(path)]
        if path.suffix.lower() not in _XML:
            source = read_source(path)
            parts += [x for name, f in source.files.items() for x in (name.encode(), f)]
            parts += [name.encode() for name in source.missing]
        for part in parts:
            digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:32]


@functools.cache
def _own_digest() -> bytes:
    """Return a digest of the code that converts a file to a model."""
    folder = Path(__file__).parent
    code = [*sorted(folder.glob("*.py")), folder.parent / "sdf.py"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in code)).digest()
