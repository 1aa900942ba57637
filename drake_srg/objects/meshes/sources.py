"""The bytes of a mesh file, and of all files that it refers to.

Readers of meshes get only these bytes, so a cache key made from them is complete.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses as dc
import json
import re
import struct
from pathlib import Path
from typing import Any, NoReturn, TypeAlias
from urllib.parse import unquote

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.tables import parse_json
from drake_srg.types import Vector

Json: TypeAlias = dict[str, Any]

SUFFIXES = (".obj", ".stl", ".glb", ".gltf")


@dc.dataclass(frozen=True, eq=False)
class MeshSource:
    """A mesh file, with the files that it refers to.

    Attributes:
        path: The file.
        content: Its bytes.
        files: Bytes of the other files, by the name that the reader requests.
        missing: Names of missing materials and textures.
        neighbours: The other files.
    """

    path: Path
    content: bytes
    files: dict[str, bytes] = dc.field(default_factory=dict)
    missing: list[str] = dc.field(default_factory=list)
    neighbours: list[Path] = dc.field(default_factory=list)

    def neighbour(self, *names: str) -> bytes | None:
        """Return the bytes of the first name that is a file, or None.

        Names are relative to the mesh's folder. A name with folders, such as a path on
        another machine, may also be a file in the mesh's folder itself.
        """
        for name in names:
            plain = name.replace("\\", "/")
            for candidate in (plain, plain.rpartition("/")[2]):
                file = self.path.parent / candidate
                if candidate and "\0" not in candidate and file.is_file():
                    self.neighbours.append(file)
                    return read_bytes(file)
        return None

    def add(self, key: str, *names: str) -> bytes:
        """Keep the bytes of the first name that is a file, and return them."""
        content = self.neighbour(*names)
        if content is None:
            self.missing.append(names[0])
            return b""
        self.files[key] = content
        return content


def read_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        ScenarioError: If it cannot be read.
    """
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None


def read_source(path: Path) -> MeshSource:
    """Read a mesh file, and the files that it refers to.

    Raises:
        ScenarioError: If the file cannot be read, or has an unknown format.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ScenarioError(
            f"{path}: unknown format (allowed: .sdf, .urdf, {', '.join(SUFFIXES)})"
        )
    source = MeshSource(path, read_bytes(path))
    if source.content.startswith(b"version https://git-lfs"):
        raise ScenarioError(f"{path}: is a pointer of Git LFS: fetch it (git lfs pull)")
    if suffix == ".obj":
        return _with_materials(source)
    if suffix == ".stl":
        return _whole_stl(source)
    try:
        return _Gltf(source).plain()
    except ScenarioError:
        raise
    except Exception as error:  # a broken file breaks the format's rules anywhere
        reason = f"{type(error).__name__}: {error}"
        raise ScenarioError(f"{path}: cannot be read as glTF: {reason[:200]}") from None


def decoded(content: bytes) -> str:
    """Decode text in UTF-8, in UTF-16 with its mark, or otherwise in Latin-1."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _whole_stl(source: MeshSource) -> MeshSource:
    """Return an STL, checked to be complete.

    Raises:
        ScenarioError: If it is cut off.
    """
    path, content = source.path, source.content
    head = decoded(content[:2000])
    if re.search("^\\s*solid.*facet", head, re.DOTALL | re.IGNORECASE):
        text = decoded(content)
        if "endsolid" not in text.lower():
            raise ScenarioError(f"{path}: is cut off: ends without 'endsolid'")
        return dc.replace(source, content="\n".join(text.splitlines()).encode())
    if len(content) >= 84:
        (count,) = struct.unpack_from("<I", content, 80)
        if len(content) != 84 + 50 * count:
            raise ScenarioError(
                f"{path}: has {len(content)} bytes, but the {count} triangles that it "
                f"announces need {84 + 50 * count}"
            )
    return source


def _with_materials(source: MeshSource) -> MeshSource:
    """Return an OBJ with the texts of all its material files as one file."""
    text = "\n".join(line.strip() for line in decoded(source.content).splitlines())
    # trimesh accepts only blanks as separators, and no comments after numbers.
    text = re.sub(r"^(vn?|vt|f)\s[^#\n]*", _with_blanks, text, flags=re.MULTILINE)
    text = re.sub(r"^((?:vn?|vt|f) [^#\n]*)#.*", r"\1", text, flags=re.MULTILINE)
    if re.search(r"^f .*?(?<![\d/.-])0+(?![\d.])", text, re.MULTILINE):
        raise ScenarioError(f"{source.path}: a face names vertex 0: they count from 1")
    found = dc.replace(source, content=text.encode())
    lines = [rest.strip() for rest in re.findall(r"^\s*mtllib\s(.*)$", text, re.M)]
    if not lines:
        return found
    materials = ""
    for line in lines:
        # The line has one name with spaces, or several names.
        names = [line] if found.neighbour(line) is not None else line.split()
        for name in names:
            materials += decoded(found.add(name, name)) + "\n"
    for line in re.findall(r"^\s*map_Kd\s(.*)$", materials, re.M | re.I):
        name = line.strip()  # options come before the name
        found.add(name, name, name.split()[-1] if name.split() else "")
    # trimesh requests one file: the text after the first "mtllib".
    asked = re.search(r"mtllib([^\n]*)", text)
    assert asked is not None
    found.files[asked[1].strip()] = materials.encode()
    known = {name.strip() for name in re.findall(r"^\s*newmtl\s(.*)$", materials, re.M)}
    used = {name.strip() for name in re.findall(r"^\s*usemtl\s(.*)$", text, re.M)}
    found.missing.extend(sorted(f"material {name}" for name in used - known))
    return found


def _with_blanks(line: re.Match[str]) -> str:
    return line[0].replace("\t", " ")


_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4"}
_COMPONENTS |= {5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}  # of indices and positions
# Extensions that do not change the geometry or that trimesh supports.
_KNOWN = re.compile(
    "KHR_mesh_quantization|KHR_texture_transform|KHR_materials_.*|KHR_lights_punctual"
    "|KHR_texture_basisu|EXT_texture_.*|KHR_xmp.*"
)
_COMPRESSION = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
_TRIANGLES, _STRIP = 4, 5
_MOST = 100_000_000  # entries of an accessor; without content, they take no bytes


class _Gltf:
    """A glTF file, simplified to the part of the format that trimesh reads correctly.

    trimesh (5.2) reads sparse accessors as zeros and normalized integers as lengths,
    and silently skips everything that it does not support.
    """

    def __init__(self, source: MeshSource) -> None:
        self._source = source
        self._tree, self._binary = self._chunks(source.content)
        self._buffers: list[bytes] = []

    def plain(self) -> MeshSource:
        """Return the file as JSON whose buffers and images are separate files.

        Raises:
            ScenarioError: If it needs a feature that is not supported.
        """
        tree = self._tree
        version = str(tree.get("asset", {}).get("version", "?"))
        if not version.startswith("2."):
            self._refuse(f"is glTF {version}, must be 2.0")
        for name in tree.get("extensionsRequired", []):
            self._check_extension(name)
        self._buffers = [self._buffer(b) for b in tree.get("buffers", [])]
        for node in tree.get("nodes", []):
            if "skin" in node and "mesh" in node:
                self._refuse("has a skin that bones move: export the mesh without them")
            if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
                self._check_extension("EXT_mesh_gpu_instancing")
        if max((a["count"] for a in tree.get("accessors", [])), default=0) > _MOST:
            self._refuse(f"has an accessor of more than {_MOST} entries")
        meshes = tree.get("meshes", [])
        if any(any(x.get("weights", [])) for x in (*meshes, *tree.get("nodes", []))):
            self._refuse("has morph targets in use: apply them before the export")
        for primitive in (p for mesh in meshes for p in mesh["primitives"]):
            self._make_plain(primitive)
        files = self._named()
        return dc.replace(self._source, content=json.dumps(tree).encode(), files=files)

    def _named(self) -> dict[str, bytes]:
        """Name all buffers and images, and return their bytes by these names."""
        tree, files = self._tree, {}
        for i, (buffer, content) in enumerate(
            zip(tree.get("buffers", []), self._buffers, strict=True)
        ):
            buffer["uri"], buffer["byteLength"] = f"buffer {i}", len(content)
            files[buffer["uri"]] = content
        for i, image in enumerate(tree.get("images", [])):
            if "uri" in image:
                name, image["uri"] = image["uri"], f"image {i}"
                picture = self._content(name)
                if picture is None:
                    self._source.missing.append(name[:60])
                files[image["uri"]] = picture or b""
        return files

    def _chunks(self, content: bytes) -> tuple[Json, bytes | None]:
        """Return the tree and the binary chunk of a file, if it has one."""
        if content[:4] != b"glTF":
            return parse_json(content.decode("utf-8-sig")), None
        version, length = struct.unpack_from("<II", content, 4)
        if version != 2:
            self._refuse(f"is binary glTF {version}, must be 2")
        if length > len(content):
            self._refuse(f"has {len(content)} of {length} bytes")
        found: dict[int, bytes] = {}
        at = 12
        while at < length:
            size, kind = struct.unpack_from("<II", content, at)
            found.setdefault(kind, content[at + 8 : at + 8 + size])
            at += 8 + size
        return parse_json(found[0x4E4F534A].decode()), found.get(0x004E4942)

    def _buffer(self, buffer: Json) -> bytes:
        if "uri" not in buffer:
            if self._binary is None or self._tree["buffers"][0] is not buffer:
                for name in buffer.get("extensions", {}):
                    self._check_extension(name)
                self._refuse("has a buffer without content")
            return self._binary
        content = self._content(buffer["uri"])
        if content is None:
            self._refuse(f"its buffer {buffer['uri'][:60]!r} does not exist")
        if len(content) < buffer["byteLength"]:
            had = f"has {len(content)} of {buffer['byteLength']} bytes"
            self._refuse(f"its buffer {buffer['uri'][:60]!r} {had}")
        return content

    def _content(self, uri: str) -> bytes | None:
        if not uri.startswith("data:"):
            return self._source.neighbour(uri, unquote(uri))
        head, _, data = uri.partition(",")
        try:
            if head.endswith(";base64"):
                return base64.b64decode(data, validate=True)
        except binascii.Error as error:
            self._refuse(f"has invalid base64: {error}")
        return unquote(data).encode("latin-1")

    def _make_plain(self, primitive: Json) -> None:
        """Give a primitive accessors of plain numbers, and check it."""
        mode = primitive.get("mode", _TRIANGLES)
        if mode < _TRIANGLES:
            return  # points and lines enclose nothing
        if mode > _STRIP:
            self._refuse("has triangle fans: export triangles")
        extensions = primitive.pop("extensions", {})
        attributes = primitive["attributes"]
        for holder, key in ((attributes, "POSITION"), (primitive, "indices")):
            if key not in holder:
                continue
            accessor = self._tree["accessors"][holder[key]]
            view = self._tree["bufferViews"][accessor.get("bufferView", 0)]
            if "EXT_meshopt_compression" in view.get("extensions", {}):
                extensions = {"EXT_meshopt_compression": None, **extensions}
            sparse = "sparse" in accessor
            if "bufferView" not in accessor and not sparse:
                for name in extensions:
                    self._check_extension(name)
                self._refuse("has vertices without content")
            if sparse or (accessor.get("normalized") and key == "POSITION"):
                holder[key] = self._add(self._values(accessor))

    def _values(self, accessor: Json) -> Vector:
        """Return the numbers of an accessor, shape (count, width)."""
        dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
        count, width = accessor["count"], _WIDTHS[accessor["type"]]
        values = np.zeros((count, width), dtype)
        if "bufferView" in accessor:
            values = self._taken(accessor, count, width, dtype).copy()
        if (sparse := accessor.get("sparse")) is not None:
            where = np.dtype(_COMPONENTS[sparse["indices"]["componentType"]])
            rows = self._taken(sparse["indices"], sparse["count"], 1, where)[:, 0]
            new = self._taken(sparse["values"], sparse["count"], width, dtype)
            values[rows] = new
        if accessor.get("normalized"):
            largest = float(np.iinfo(dtype).max)
            return np.maximum(values / largest, -1.0).astype("<f4")
        return values

    def _taken(self, place: Json, count: int, width: int, dtype: np.dtype) -> Vector:
        view = self._tree["bufferViews"][place["bufferView"]]
        size = dtype.itemsize
        return np.ndarray(
            (count, width),
            dtype,
            self._buffers[view["buffer"]],
            view.get("byteOffset", 0) + place.get("byteOffset", 0),
            (view.get("byteStride", size * width), size),
        )

    def _add(self, values: Vector) -> int:
        """Append an accessor of numbers, in a buffer of its own; return its index."""
        tree, content = self._tree, np.ascontiguousarray(values).tobytes()
        kinds = {np.dtype(text): kind for kind, text in _COMPONENTS.items()}
        tree["buffers"].append({})
        self._buffers.append(content)
        tree["bufferViews"].append(
            {"buffer": len(self._buffers) - 1, "byteLength": len(content)}
        )
        accessor = {
            "bufferView": len(tree["bufferViews"]) - 1,
            "componentType": kinds[values.dtype],
            "count": len(values),
            "type": "VEC3" if values.shape[1] == 3 else "SCALAR",
        }
        tree["accessors"].append(accessor)
        return len(tree["accessors"]) - 1

    def _check_extension(self, name: str) -> None:
        if _KNOWN.fullmatch(name):
            return
        hint = "without compression" if name in _COMPRESSION else "without it"
        self._refuse(f"needs the glTF extension {name} (export {hint})")

    def _refuse(self, problem: str) -> NoReturn:
        raise ScenarioError(f"{self._source.path}: {problem}")
