"""Reads glTF strictly: any violation of the specification fails."""

import numpy as np

from drake_srg.recording.replay.glb import read_glb

COMPONENTS = {5123: np.dtype("<u2"), 5125: np.dtype("<u4"), 5126: np.dtype("<f4")}
SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Strict:
    """A GLB file that has been checked."""

    def __init__(self, data):
        assert len(data) % 4 == 0
        self.document, self.binary = read_glb(data)
        document = self.document
        assert document["asset"]["version"] == "2.0"
        (buffer,) = document["buffers"]
        assert buffer["byteLength"] == len(self.binary)
        for view in document["bufferViews"]:
            assert view["byteOffset"] % 4 == 0
            assert view["byteOffset"] + view["byteLength"] <= len(self.binary)
        for index, accessor in enumerate(document["accessors"]):
            rows = self.array(index)
            assert accessor["count"] == len(rows) > 0
            if "min" in accessor:
                assert accessor["min"] == rows.reshape(len(rows), -1).min(0).tolist()
                assert accessor["max"] == rows.reshape(len(rows), -1).max(0).tolist()
        for mesh in document.get("meshes", []):
            for primitive in mesh["primitives"]:
                self._check_primitive(primitive)
        children = [i for n in document["nodes"] for i in n.get("children", [])]
        roots = document["scenes"][document["scene"]]["nodes"]
        assert sorted(children + roots) == list(range(len(document["nodes"])))
        names = [node["name"] for node in document["nodes"]]
        assert len(set(names)) == len(names)
        for node in document["nodes"]:
            assert abs(np.linalg.norm(node.get("rotation", [0, 0, 0, 1])) - 1) < 1e-6
        for animation in document.get("animations", []):
            self._check_animation(animation)

    def array(self, index):
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        data = self.binary[view["byteOffset"] :][: view["byteLength"]]
        rows = np.frombuffer(data, COMPONENTS[accessor["componentType"]])
        size = SIZES[accessor["type"]]
        return rows if size == 1 else rows.reshape(-1, size)

    def _check_primitive(self, primitive):
        points = self.array(primitive["attributes"]["POSITION"])
        normals = self.array(primitive["attributes"]["NORMAL"])
        indices = self.array(primitive["indices"])
        position = primitive["attributes"]["POSITION"]
        assert {"min", "max"} <= self.document["accessors"][position].keys()
        assert len(points) == len(normals)
        # Validators of glTF tolerate as much.
        assert np.all(np.abs(np.linalg.norm(normals, axis=1) - 1) < 5e-4)
        assert len(indices) % 3 == 0
        assert indices.max() < len(points)
        for target in primitive.get("targets", []):
            assert len(self.array(target["POSITION"])) == len(points)
        color = self.document["materials"][primitive["material"]]
        factors = color["pbrMetallicRoughness"]["baseColorFactor"]
        assert all(0 <= factor <= 1 for factor in factors)

    def _check_animation(self, animation):
        targets = []
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            time, values = self.array(sampler["input"]), self.array(sampler["output"])
            assert np.all(np.diff(time) > 0)
            node, path = channel["target"]["node"], channel["target"]["path"]
            targets.append((node, path))
            if path == "weights":
                mesh = self.document["meshes"][self.document["nodes"][node]["mesh"]]
                assert len(values) == len(time) * len(mesh["weights"])
            else:
                assert len(values) == len(time)
            if path == "rotation":
                assert np.all(np.abs(np.linalg.norm(values, axis=1) - 1) < 1e-6)
                assert np.all(np.sum(values[1:] * values[:-1], axis=1) > 0)
        assert len(set(targets)) == len(targets)

    def node(self, name):
        (index,) = [
            i for i, n in enumerate(self.document["nodes"]) if n["name"] == name
        ]
        return index, self.document["nodes"][index]

    def track(self, name, path):
        """Return times and values of a node's property, or None if it is constant."""
        index, _ = self.node(name)
        for animation in self.document.get("animations", []):
            for channel in animation["channels"]:
                if channel["target"] == {"node": index, "path": path}:
                    sampler = animation["samplers"][channel["sampler"]]
                    return self.array(sampler["input"]), self.array(sampler["output"])
        return None
