import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.simulate import keep_first_replay, take_replay_folder


def test_only_the_first_run_gets_the_folder(tmp_path):
    assert take_replay_folder() is None
    with keep_first_replay(tmp_path):
        assert take_replay_folder() == tmp_path
        assert take_replay_folder() is None
        with keep_first_replay(None):
            assert take_replay_folder() is None
    assert take_replay_folder() is None


@pytest.mark.slow
def test_a_run_without_recordings_leaves_its_replay_there(tmp_path):
    scenario = load_scenario("kitchen", overrides=["object.present=false"])
    with keep_first_replay(tmp_path):
        kept = Simulate(scenario)
    assert (tmp_path / "replay.html").stat().st_size > 100_000
    assert kept.metrics.artifacts == dict.fromkeys(kept.metrics.artifacts)
    # It changes nothing else.
    again = Simulate(scenario)
    assert kept.log.keys() == again.log.keys()
    assert all((kept.log[name] == again.log[name]).all() for name in kept.log)
