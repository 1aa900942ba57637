"""Animated glTF 2.0 in one binary file, with equal bytes for equal scenes."""

from __future__ import annotations

import dataclasses as dc
import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.recording.replay.triangles import Triangles
from drake_srg.types import Vector

Json = dict[str, Any]

_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # kinds of chunks
_KINDS = {"f": 5126, "H": 5123, "I": 5125}  # glTF's numbers of component types
# Smaller motions are not animated: 1 m from the origin, a float32 cannot resolve them.
_STILL = 1e-7
# Our key in `extras`, which glTF leaves to applications.
EXTRAS = "drake_srg"


@dc.dataclass(frozen=True)
class Part:
    """A surface of one colour, with morph targets.

    Attributes:
        surface: Its triangles.
        color: Red, green, blue, opacity, 0 .. 1 (sRGB).
        targets: Displacements of the points, one array (n, 3) per morph target [m].
    """

    surface: Triangles
    color: tuple[float, float, float, float]
    targets: Sequence[Vector] = ()


@dc.dataclass(frozen=True)
class Track:
    """Values of a node's property over time, to be interpolated linearly.

    Attributes:
        time: [s], increasing, shape (K,).
        values: Shape (K, n): translation (3) [m], rotation (4) as a unit quaternion
            x, y, z, w, scale (3), or the weights of the morph targets.
    """

    time: Vector
    values: Vector


@dc.dataclass
class Node:
    """A node of the scene.

    Attributes:
        name: Its unique name.
        parts: Its visible parts.
        tracks: Its motion, by property: translation, rotation, scale, weights.
        camera: A perspective camera in glTF's form; it looks along the node's -z.
        extras: Anything else in JSON.
    """

    name: str
    parts: Sequence[Part] = ()
    tracks: dict[str, Track] = dc.field(default_factory=dict)
    camera: Json | None = None
    extras: Json | None = None


def write_glb(
    nodes: Sequence[Node], extras: Mapping[str, Any], images: Sequence[bytes] = ()
) -> bytes:
    """Return a GLB file; the nodes' z axis becomes y, which glTF defines as up.

    Args:
        nodes: The scene.
        extras: JSON to store in the scene under EXTRAS.
        images: JPEG files; `extras` refers to them by index.
    """
    return _Writer().write(nodes, extras, images)


class _Writer:
    """The arrays of a file; equal ones are stored once."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._known: dict[tuple[str, bytes | str], int] = {}
        self._json: dict[str, list[Any]] = {
            "bufferViews": [],
            "accessors": [],
            "materials": [],
            "meshes": [],
            "cameras": [],
            "images": [],
            "nodes": [],
        }

    def write(
        self, nodes: Sequence[Node], extras: Mapping[str, Any], images: Sequence[bytes]
    ) -> bytes:
        channels: list[Json] = []
        samplers: list[Json] = []
        for index, node in enumerate(nodes):
            entry = self._node(node)
            for path, track in node.tracks.items():
                values = track.values.astype(np.float32)
                if path == "rotation":
                    values = _continuous(values)
                if np.ptp(values, axis=0).max() > _STILL:
                    sampler = {
                        "input": self._array(track.time, "SCALAR", limits=True),
                        "output": self._array(
                            values.ravel() if path == "weights" else values,
                            "SCALAR" if path == "weights" else f"VEC{values.shape[1]}",
                        ),
                    }
                    channels.append(
                        {
                            "sampler": len(samplers),
                            "target": {"node": index, "path": path},
                        }
                    )
                    samplers.append(sampler)
                if path != "weights":
                    entry[path] = [float(x) for x in values[0]]
            self._json["nodes"].append(entry)
        for image in images:
            entry = {"bufferView": self._view(image), "mimeType": "image/jpeg"}
            # Not by `_add`, which would merge equal images and change their indices.
            self._json["images"].append(entry)
        half = float(np.sqrt(0.5))
        root = {
            "name": "world (z up)",
            "rotation": [-half, 0.0, 0.0, half],
            "children": list(range(len(nodes))),
        }
        self._json["nodes"].append(root)
        document: Json = {
            "asset": {"version": "2.0", "generator": "drake_srg"},
            "scene": 0,
            "scenes": [{"nodes": [len(nodes)], "extras": {EXTRAS: dict(extras)}}],
            "buffers": [{"byteLength": len(self._binary)}],
            **{name: entries for name, entries in self._json.items() if entries},
        }
        if channels:
            document["animations"] = [
                {"name": "run", "channels": channels, "samplers": samplers}
            ]
        return _packed(document, bytes(self._binary))

    def _node(self, node: Node) -> Json:
        entry: Json = {"name": node.name}
        if node.parts:
            mesh: Json = {"primitives": [self._primitive(part) for part in node.parts]}
            if count := len(node.parts[0].targets):
                mesh["weights"] = [0.0] * count
            entry["mesh"] = self._add("meshes", mesh)
        if node.camera is not None:
            camera = {"type": "perspective", "perspective": node.camera}
            entry["camera"] = self._add("cameras", camera)
        if node.extras is not None:
            entry["extras"] = {EXTRAS: node.extras}
        return entry

    def _primitive(self, part: Part) -> Json:
        surface = part.surface
        attributes = {
            "POSITION": self._array(surface.points, "VEC3", limits=True),
            "NORMAL": self._array(_units(surface.normals), "VEC3"),
        }
        kind = "H" if len(surface.points) < 65535 else "I"
        primitive: Json = {
            "attributes": attributes,
            "indices": self._array(surface.faces.ravel(), "SCALAR", kind),
            "material": self._material(part.color),
        }
        if part.targets:
            primitive["targets"] = [
                {"POSITION": self._array(target, "VEC3", limits=True)}
                for target in part.targets
            ]
        return primitive

    def _material(self, color: Sequence[float]) -> int:
        # glTF's colours are linear, Drake's are not.
        rgb = [round(float(np.clip(c, 0, 1) ** 2.2), 4) for c in color[:3]]
        material: Json = {
            "pbrMetallicRoughness": {
                "baseColorFactor": [*rgb, float(color[3])],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.6,
            }
        }
        if color[3] < 1.0:
            material["alphaMode"] = "BLEND"
        return self._add("materials", material)

    def _array(
        self, values: npt.ArrayLike, shape: str, kind: str = "f", limits: bool = False
    ) -> int:
        array = np.ascontiguousarray(values, dtype=f"<{kind}")
        accessor: Json = {
            "bufferView": self._view(array.tobytes()),
            "componentType": _KINDS[kind],
            "count": len(array),
            "type": shape,
        }
        if limits:
            rows = array.reshape(len(array), -1)
            accessor["min"] = rows.min(axis=0).tolist()
            accessor["max"] = rows.max(axis=0).tolist()
        return self._add("accessors", accessor)

    def _view(self, data: bytes) -> int:
        if (key := ("binary", data)) not in self._known:
            view = {"buffer": 0, "byteOffset": len(self._binary)}
            view["byteLength"] = len(data)
            self._binary += data + bytes(-len(data) % 4)
            self._known[key] = self._add("bufferViews", view)
        return self._known[key]

    def _add(self, name: str, entry: Json) -> int:
        """Return the index of an entry in a list of the file, added if it is new."""
        key = (name, json.dumps(entry))
        if key not in self._known:
            self._known[key] = len(self._json[name])
            self._json[name].append(entry)
        return self._known[key]


def _units(normals: Vector) -> Vector:
    """Return normals rounded to a few significant bits, which compress well."""
    bits = normals.astype(np.float32).view(np.uint32)
    return ((bits + 0x400) & np.uint32(0xFFFFF800)).view(np.float32)


def _continuous(rotations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return quaternions whose signs are such that each is close to its predecessor."""
    turned = np.sum(rotations[1:] * rotations[:-1], axis=1) < 0
    signs = np.cumprod(np.where(turned, -1, 1))
    return rotations * np.concatenate([[1], signs]).astype(np.float32)[:, None]


def _packed(document: Json, binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(binary)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, size),
            struct.pack("<II", len(text), _JSON),
            text,
            struct.pack("<II", len(binary), _BINARY),
            binary,
        ]
    )


def read_glb(data: bytes) -> tuple[Json, bytes]:
    """Return the JSON document and the binary chunk of a GLB file.

    Raises:
        ValueError: If it is not a GLB file, or is cut off.
    """
    try:
        magic, version, size = struct.unpack_from("<4sII", data)
        length, kind = struct.unpack_from("<II", data, 12)
        start = 20 + length
        rest, binary = struct.unpack_from("<II", data, start)
    except struct.error as error:
        raise ValueError("not a GLB file") from error
    known = (magic, version, kind, binary) == (b"glTF", 2, _JSON, _BINARY)
    if not known or size != len(data) or start + 8 + rest != size:
        raise ValueError("not a complete GLB file of glTF 2.0")
    return json.loads(data[20:start]), data[start + 8 :]
