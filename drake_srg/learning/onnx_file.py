"""Policies as ONNX files, for other programs: the extra `learn`."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from drake_srg.learning.policy import MOST_SCALED, Policy
from drake_srg.sweeps.files import write_file

_OPSET = 18


def can_write_onnx(policy: Policy) -> bool:
    """Return whether ONNX is installed, and the policy is a network's output."""
    return policy.kind == "actor" and importlib.util.find_spec("onnx") is not None


def write_onnx(policy: Policy, path: Path) -> None:
    """Write a policy as a graph from `observation` (1, n) to `action` (1, m).

    Args:
        policy: Of kind `actor`.
        path: The .onnx file.

    Raises:
        OSError: If it cannot be written.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    span = policy.high - policy.low
    constants = {
        "gain": 2.0 / span,
        "offset": -(policy.high + policy.low) / span,
        "least": np.array(-MOST_SCALED),
        "most": np.array(MOST_SCALED),
    }
    nodes = [
        helper.make_node("Mul", ["observation", "gain"], ["stretched"]),
        helper.make_node("Add", ["stretched", "offset"], ["moved"]),
        helper.make_node("Clip", ["moved", "least", "most"], ["x_0"]),
    ]
    layers = list(zip(policy.network.weights, policy.network.biases, strict=True))
    for k, (weight, bias) in enumerate(layers):
        constants |= {f"weight_{k}": weight[0], f"bias_{k}": bias[0, 0]}
        inputs = [f"x_{k}", f"weight_{k}", f"bias_{k}"]
        nodes.append(helper.make_node("Gemm", inputs, [f"y_{k}"]))
        last = k == len(layers) - 1
        kind, out = ("Tanh", "action") if last else ("Relu", f"x_{k + 1}")
        nodes.append(helper.make_node(kind, [f"y_{k}"], [out]))
    ports = [
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size])]
        for name, size in (("observation", policy.low.size), ("action", policy.actions))
    ]
    tensors = [
        numpy_helper.from_array(np.asarray(value, np.float32), name)
        for name, value in constants.items()
    ]
    graph = helper.make_graph(nodes, "policy", *ports, tensors)
    opset = [helper.make_opsetid("", _OPSET)]
    model = helper.make_model(graph, opset_imports=opset, producer_name="drake_srg")
    onnx.checker.check_model(model)
    write_file(path, model.SerializeToString())
