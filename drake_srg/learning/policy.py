"""Policies: multilayer perceptrons in NumPy, and their files."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from numpy.random import default_rng

from drake_srg.common.exceptions import ScenarioError, checked_types, one_line
from drake_srg.recording.output import write_log
from drake_srg.sweeps.files import write_file

Array = npt.NDArray[np.floating]

# The cross-entropy method (Rubinstein, 1999), as QT-Opt uses it for grasps (Kalashnikov
# et al., CoRL 2018): number of rounds, of actions per round, and of the best actions
# from which the next round is drawn.
_ROUNDS, _TRIED, _BEST = 3, 64, 6
# Default of `best_action`'s `caution`.
_CAUTION = 0.5


@dc.dataclass(frozen=True, eq=False)
class Network:
    """An ensemble of perceptrons with ReLU between linear layers.

    Attributes:
        weights: Weights of each layer, shape (members, inputs, outputs).
        biases: Biases of each layer, shape (members, 1, outputs).
    """

    weights: list[Array]
    biases: list[Array]

    @property
    def members(self) -> int:
        """Number of networks."""
        return int(self.weights[0].shape[0])

    @property
    def parameters(self) -> list[Array]:
        """All weights and biases, not copied."""
        return [*self.weights, *self.biases]

    def member(self, index: int) -> Network:
        """Return one of the networks, with shared parameters."""
        one = slice(index, index + 1)
        return Network([w[one] for w in self.weights], [b[one] for b in self.biases])

    def __call__(self, x: Array) -> Array:
        """Return the outputs, shape (members, n, outputs).

        Args:
            x: Shape (n, inputs) for all, or (members, n, inputs).
        """
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight + bias
            if k < last:
                x = np.maximum(x, 0.0)
        return x


def best_action(
    network: Network,
    x: Array,
    actions: int,
    *,
    caution: float = _CAUTION,
    seed: int = 0,
) -> Array:
    """Return the action with the greatest value according to an ensemble.

    The same arguments give the same action.

    Args:
        network: Gives the value of (observation, action); its members are averaged.
        x: Scaled observation, shape (n,).
        actions: Number of entries of an action.
        caution: Standard deviations between members to subtract from the mean.
        seed: Seed of the search.

    Returns:
        Shape (actions,), each in -1 .. 1.
    """
    rng = default_rng(seed)
    mean, spread = np.zeros(actions), np.ones(actions)
    tried = rng.uniform(-1.0, 1.0, size=(4 * _TRIED, actions))
    for _ in range(_ROUNDS):
        inputs = np.concatenate([np.broadcast_to(x, (len(tried), len(x))), tried], 1)
        values = network(inputs.astype(np.float32))[:, :, 0]
        value = values.mean(axis=0) - caution * values.std(axis=0)
        best = tried[np.argsort(-value, kind="stable")[:_BEST]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
        drawn = mean + spread * rng.normal(size=(_TRIED, actions))
        tried = np.clip(np.concatenate([best, drawn]), -1.0, 1.0)
    return np.asarray(best[0], np.float32)


FORMAT = 1  # of the file; a reader refuses others
# Kinds of network: `actor` returns the action, `q` the value of an action.
Kind = Literal["actor", "q"]
KINDS: tuple[Kind, ...] = ("actor", "q")
_MOST_LAYERS = 16
# Greatest scaled value of observations outside their range.
MOST_SCALED = 2.0
_OPSET = 18  # of ONNX


@dc.dataclass(frozen=True)
class PolicyInfo:
    """Provenance of a policy: its environment and its training.

    Attributes:
        environment: Id of its environment.
        keywords: The environment's keywords in training, such as `driver`.
        algorithm: `q`, `sac`, `bc` or `dagger`.
        version: Version of drake_srg.
        command: The command line that made it.
        seed: Seed of training.
        steps: Environment steps of training.
        scores: Success rates by name, such as `validation`.
    """

    environment: str
    keywords: dict[str, Any]
    algorithm: str
    version: str
    command: str = ""
    seed: int = 0
    steps: int = 0
    scores: dict[str, float] = dc.field(default_factory=dict)


@dc.dataclass(frozen=True, eq=False)
class Policy:
    """A function from observations to actions, both flat vectors.

    Attributes:
        kind: `actor`: tanh of the network's output is the action. `q`: the network
            values an observation and an action, and the cross-entropy method searches
            for the best action.
        network: One network, or an ensemble.
        low: Values of the observation that are scaled to -1, shape (n,).
        high: Values that are scaled to 1, shape (n,).
        actions: Number of entries of the action.
        info: Its provenance.
    """

    kind: Kind
    network: Network
    low: Array
    high: Array
    actions: int
    info: PolicyInfo

    def __call__(self, observation: Array) -> Array:
        """Return the action for an observation, shape (actions,), each in -1 .. 1."""
        x = scaled(observation, self.low, self.high)
        if self.kind == "actor":
            action: Array = np.tanh(self.network(x[None])[0, 0])
            return action
        return best_action(self.network, x, self.actions)

    def save(self, path: Path) -> None:
        """Write the policy, completely or not at all; equal policies give equal bytes.

        Raises:
            OSError: If it cannot be written.
        """
        arrays = {
            "info": np.array(json.dumps(dc.asdict(self.info), sort_keys=True)),
            "format": np.array(FORMAT),
            "kind": np.array(self.kind),
            "low": self.low,
            "high": self.high,
            "actions": np.array(self.actions),
        }
        for k, (weight, bias) in enumerate(
            zip(self.network.weights, self.network.biases, strict=True)
        ):
            arrays |= {f"weight_{k}": weight, f"bias_{k}": bias}
        write_log(path, arrays)


def write_onnx(policy: Policy, path: Path) -> None:
    """Write a policy as a graph from `observation` (1, n) to `action` (1, m).

    Args:
        policy: A policy of kind `actor`.
        path: The .onnx file.

    Raises:
        OSError: If it cannot be written.
        ImportError: If the extra `learn` is missing.
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


def load_policy(path: Path | str) -> Policy:
    """Read a policy.

    Args:
        path: A file that `Policy.save` wrote, or the name of a policy of the package.

    Raises:
        ScenarioError: If it cannot be read or is not a policy.
    """
    path = _find(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return _policy(arrays)
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    except Exception as error:  # damaged archives raise a dozen kinds
        raise ScenarioError(f"{path}: is not a policy: {one_line(error)}") from None


def check_sizes(name: str, policy: Policy, observations: int, actions: int) -> None:
    """Check the numbers of a policy's observations and actions.

    Raises:
        ScenarioError: If one differs.
    """
    for what, own, needed in (
        ("observations", policy.low.size, observations),
        ("actions", policy.actions, actions),
    ):
        if own != needed:
            raise ScenarioError(
                f"{name}: has {own} {what}, {policy.info.environment} needs {needed}; "
                f"it was trained by drake_srg {policy.info.version}"
            )


def policy_digest(path: Path | str) -> str:
    """Return the SHA-256 of a policy's file, independent of its name.

    Raises:
        ScenarioError: If it cannot be read.
    """
    path = _find(path)
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None


def shipped_policies() -> dict[str, Path]:
    """Return the policies of the package by name."""
    folder = Path(__file__).parent / "policies"
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}


def _find(path: Path | str) -> Path:
    shipped = shipped_policies()
    if str(path) in shipped:
        return shipped[str(path)]
    path = Path(path)
    if path.suffix != ".npz":
        names = ", ".join(shipped) or "none"
        raise ScenarioError(
            f"{path}: unknown policy (allowed: a .npz file, or one of: {names})"
        )
    return path


def _policy(arrays: dict[str, Any]) -> Policy:
    """Return the policy in the arrays of a file.

    Raises:
        ValueError: If sizes do not fit, or the format is another one.
        KeyError: If an array is missing.
        TypeError: If an entry of `info` is unknown, missing or of another type.
    """
    if int(arrays["format"]) != FORMAT:
        raise ValueError(f"format {arrays['format']} (allowed: {FORMAT})")
    kind = str(arrays["kind"])
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r} (allowed: {', '.join(KINDS)})")
    layers = [k for k in range(_MOST_LAYERS) if f"weight_{k}" in arrays]
    weights = [arrays[f"weight_{k}"].astype(np.float32) for k in layers]
    biases = [arrays[f"bias_{k}"].astype(np.float32) for k in layers]
    low, high = (arrays[name].astype(np.float32) for name in ("low", "high"))
    actions = int(arrays["actions"])
    network = Network(weights, biases)
    inputs = low.size if kind == "actor" else low.size + actions
    outputs = actions if kind == "actor" else 1
    _check_sizes(network, inputs, outputs)
    if low.shape != high.shape or low.ndim != 1 or not np.all(low < high):
        raise ValueError("low and high must be vectors of one size, low below high")
    if not all(np.isfinite(p).all() for p in (low, high, *network.parameters)):
        raise ValueError("low, high and weights must be finite")
    info = checked_types(PolicyInfo(**json.loads(str(arrays["info"]))))
    return Policy(kind, network, low, high, actions, info)


def _check_sizes(network: Network, inputs: int, outputs: int) -> None:
    """Check that the sizes of the layers fit each other, `inputs` and `outputs`.

    Raises:
        ValueError: If they do not fit.
    """
    if not network.weights or any(w.ndim != 3 for w in network.weights):
        raise ValueError("weights are missing or have wrong shapes")
    size = inputs
    for weight, bias in zip(network.weights, network.biases, strict=True):
        members, into, out = weight.shape
        if (members, into) != (network.members, size) or bias.shape != (
            members,
            1,
            out,
        ):
            raise ValueError("weights do not fit each other or the observation")
        size = out
    if size != outputs:
        raise ValueError(f"the network must have {outputs} outputs, got {size}")


def scaled(observation: Array, low: Array, high: Array) -> Array:
    """Return an observation with its range scaled to -1 .. 1."""
    x = (2.0 * observation - (high + low)) / (high - low)
    return np.clip(x, -MOST_SCALED, MOST_SCALED).astype(np.float32)
