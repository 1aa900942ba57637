"""Reads the nodes of a scene that `glb.write_glb` wrote."""

from __future__ import annotations

from typing import Any

import numpy as np

from drake_srg.replay.glb import EXTRAS, Json, Node, Part, Track
from drake_srg.replay.triangles import Triangles
from drake_srg.types import Vector

_DTYPES = {5126: "<f4", 5123: "<u2", 5125: "<u4"}  # glTF's component types
_SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_PROPERTIES = ("translation", "rotation", "scale")


def read_nodes(document: Json, binary: bytes) -> list[Node]:
    """Return the nodes below the root, whose `z` is up, in the file's order.

    A property that does not change has a track of one sample, at time 0.

    Args:
        document: The file's JSON.
        binary: Its binary chunk.

    Raises:
        ValueError: If it is not such a scene.
    """
    try:
        return _Reader(document, binary).nodes()
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"not a scene of ours: {error!r}") from error


class _Reader:
    def __init__(self, document: Json, binary: bytes) -> None:
        self._document, self._binary = document, binary

    def nodes(self) -> list[Node]:
        (root,) = self._document["scenes"][0]["nodes"]
        index = self._document["nodes"][root]["children"]
        nodes = {i: self._node(self._document["nodes"][i]) for i in index}
        for animation in self._document.get("animations", []):
            for channel in animation["channels"]:
                target = channel["target"]
                node, path = nodes[target["node"]], target["path"]
                sampler = animation["samplers"][channel["sampler"]]
                time = self._array(sampler["input"])
                values = self._array(sampler["output"])
                node.tracks[path] = Track(time, values.reshape(len(time), -1))
        return list(nodes.values())

    def _node(self, entry: Json) -> Node:
        tracks = {
            path: Track(np.zeros(1), np.array([entry[path]], dtype=float))
            for path in _PROPERTIES
            if path in entry
        }
        mesh: Json = {"primitives": []}
        if "mesh" in entry:
            mesh = self._document["meshes"][entry["mesh"]]
        camera = None
        if "camera" in entry:
            camera = self._document["cameras"][entry["camera"]]["perspective"]
        return Node(
            entry["name"],
            [self._part(primitive) for primitive in mesh["primitives"]],
            tracks,
            camera,
            entry.get("extras", {}).get(EXTRAS),
        )

    def _part(self, primitive: Json) -> Part:
        attributes = primitive["attributes"]
        surface = Triangles(
            self._array(attributes["POSITION"]),
            self._array(attributes["NORMAL"]),
            self._array(primitive["indices"]).reshape(-1, 3).astype(np.int64),
        )
        material = self._document["materials"][primitive["material"]]
        *rgb, alpha = material["pbrMetallicRoughness"]["baseColorFactor"]
        # glTF's colours are linear, ours are not.
        r, g, b = (float(value ** (1 / 2.2)) for value in rgb)
        targets = [self._array(t["POSITION"]) for t in primitive.get("targets", [])]
        return Part(surface, (r, g, b, float(alpha)), targets)

    def _array(self, index: int) -> Vector:
        accessor: dict[str, Any] = self._document["accessors"][index]
        view = self._document["bufferViews"][accessor["bufferView"]]
        data = self._binary[view["byteOffset"] :][: view["byteLength"]]
        rows = np.frombuffer(data, _DTYPES[accessor["componentType"]]).astype(float)
        size = _SIZES[accessor["type"]]
        return rows if size == 1 else rows.reshape(-1, size)
