"""Policies without training."""

import numpy as np

from drake_srg.learning.network import Network
from drake_srg.learning.policy import Policy, PolicyInfo


def info(environment="toy/Hit-v0", **changes):
    return PolicyInfo(
        environment=environment,
        keywords={"driver": "plant"},
        algorithm="q",
        version="0.1.0",
        **changes,
    )


def made_policy(kind="actor", n=2, m=2, **changes):
    sizes = (n, 8, m) if kind == "actor" else (n + m, 8, 1)
    network = Network.random(
        sizes, np.random.default_rng(0), 1 if kind == "actor" else 3
    )
    low, high = np.full(n, -2.0, np.float32), np.full(n, 4.0, np.float32)
    return Policy(kind, network, low, high, m, info(**changes))
