"""Policies without training."""

import itertools

import numpy as np

from drake_srg.learning.policy import Network, Policy, PolicyInfo


def made_network(sizes, members=1, seed=0):
    rng = np.random.default_rng(seed)
    return Network(
        [
            rng.normal(size=(members, a, b)).astype(np.float32)
            for a, b in itertools.pairwise(sizes)
        ],
        [np.zeros((members, 1, b), np.float32) for b in sizes[1:]],
    )


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
    network = made_network(sizes, 1 if kind == "actor" else 3)
    low, high = np.full(n, -2.0, np.float32), np.full(n, 4.0, np.float32)
    return Policy(kind, network, low, high, m, info(**changes))
