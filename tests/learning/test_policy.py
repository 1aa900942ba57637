import dataclasses as dc
import io
import json

import numpy as np
import pytest
from helpers import check_reads_or_refuses, damaged
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.policy import KINDS, best_action, load_policy, scaled
from drake_srg.recording.output import write_log

from .made_policies import made_network, made_policy


@given(st.lists(st.integers(1, 5), min_size=2, max_size=4), st.integers(1, 3))
def test_a_network_has_the_sizes_it_was_made_with(sizes, members):
    network = made_network(sizes, members)
    assert network(np.zeros((7, sizes[0]), np.float32)).shape == (members, 7, sizes[-1])


def test_a_member_is_one_of_the_ensemble():
    network = made_network((3, 4, 1), members=3)
    x = np.ones((2, 3), np.float32)
    for k in range(3):
        np.testing.assert_allclose(network.member(k)(x)[0], network(x)[k], rtol=1e-5)


class Peak:
    """Values with a single peak."""

    def __init__(self, at, spread=0.0):
        self.at, self.spread = np.array(at), spread

    def __call__(self, x):
        a = x[:, -len(self.at) :]
        value = -np.sum((a - self.at) ** 2, axis=1)
        # The second member trusts no positive first entry.
        doubt = self.spread * np.maximum(a[:, 0], 0.0)
        return np.stack([value + doubt, value - doubt])[..., None]


def test_the_peak_is_found():
    x = np.zeros(2, np.float32)
    for at in ([0.3, -0.7], [0.9, 0.9], [0.0, 0.0]):
        found = best_action(Peak(at), x, 2)
        np.testing.assert_allclose(found, at, atol=0.08)
        np.testing.assert_array_equal(best_action(Peak(at), x, 2), found)


def test_where_members_differ_the_action_is_avoided():
    x = np.zeros(2, np.float32)
    bold = best_action(Peak([0.5, 0.0], 3.0), x, 2, caution=0.0)
    careful = best_action(Peak([0.5, 0.0], 3.0), x, 2, caution=1.0)
    assert careful[0] < 0.1 < bold[0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_policy_read_back_acts_the_same(tmp_path, kind):
    policy = made_policy(kind, scores={"validation": 0.9}, steps=7, seed=3, command="x")
    policy.save(tmp_path / "policy.npz")
    again = load_policy(tmp_path / "policy.npz")
    assert again.info == policy.info
    again.save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == (
        tmp_path / "policy.npz"
    ).read_bytes()
    for x in np.random.default_rng(1).uniform(-2.0, 4.0, (5, 2)).astype(np.float32):
        np.testing.assert_array_equal(again(x), policy(x))


@pytest.mark.parametrize("kind", KINDS)
@given(x=st.lists(st.floats(-1e6, 1e6, width=32), min_size=2, max_size=2))
def test_actions_are_within_bounds(kind, x):
    action = made_policy(kind)(np.array(x, np.float32))
    assert action.dtype == np.float32
    assert np.all(np.abs(action) <= 1.0)


def test_the_range_of_an_observation_becomes_that_of_the_network():
    low, high = np.array([-2.0, 0.0]), np.array([4.0, 1.0])
    np.testing.assert_allclose(scaled(low, low, high), -1.0)
    np.testing.assert_allclose(scaled(high, low, high), 1.0)


@given(data=st.data())
def test_a_damaged_file_is_one_line_or_still_a_policy(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "policy.npz"
    made_policy().save(path)
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    check_reads_or_refuses(load_policy, path)


@pytest.mark.parametrize("content", [b"", b"PK", b"not a zip at all"])
def test_something_else_is_no_policy(tmp_path, content):
    path = tmp_path / "policy.npz"
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match=r"policy.npz: is not a policy"):
        load_policy(path)


def test_a_pickle_is_not_read(tmp_path):
    stream = io.BytesIO()
    np.savez(stream, format=np.array([{"a": 1}], dtype=object))
    (tmp_path / "policy.npz").write_bytes(stream.getvalue())
    with pytest.raises(ScenarioError, match="is not a policy"):
        load_policy(tmp_path / "policy.npz")


def info_with(**changes):
    return np.array(json.dumps(dc.asdict(made_policy().info) | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array(2)}, "format 2"),
        ({"kind": np.array("x")}, "kind 'x'"),
        ({"low": np.zeros(3, np.float32)}, "do not fit"),
        ({"weight_1": np.zeros((1, 8, 5), np.float32)}, "do not fit"),
        ({"bias_1": np.full((1, 1, 2), np.nan, np.float32)}, "finite"),
        ({"low": np.full(2, -np.inf)}, "finite"),
        ({"high": np.full(2, np.inf)}, "finite"),
        ({"info": np.array('{"what": 1}')}, "what"),
        ({"info": info_with(keywords=[])}, "keywords: must be"),
        ({"info": info_with(scores=3)}, "scores: must be"),
    ],
)
def test_what_is_wrong_with_a_file_is_told(tmp_path, changes, message):
    path = tmp_path / "policy.npz"
    made_policy().save(path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    write_log(path, arrays | changes)
    with pytest.raises(ScenarioError, match=message):
        load_policy(path)


def test_a_missing_file_and_an_unknown_name_are_told(tmp_path):
    with pytest.raises(ScenarioError, match="No such file"):
        load_policy(tmp_path / "none.npz")
    with pytest.raises(ScenarioError, match=r"unknown policy \(allowed: a .npz file"):
        load_policy("none")
