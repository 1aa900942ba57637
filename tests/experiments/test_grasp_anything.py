import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import grasp_anything
from drake_srg.recording.timeline import save_png


def track(cases, label=str):
    yield from cases


def test_a_can_is_found_grasped_and_lifted(tmp_path):
    result = grasp_anything.run(
        track, objects=["005_tomato_soup_can"], trials=1, seed=4, attempts=1
    )
    rows = {(row.name, row.quantity): row.measured for row in result.rows}
    assert rows["all", "trials"] == 1
    assert rows["all", "held, first attempt"] == 1.0
    assert rows["fingers", "felt held, was not"] == 0
    table = result.tables["attempts"]
    assert table["object"] == ["005_tomato_soup_can"]
    assert table["held"] == [1]
    assert 60 < table["width [mm]"][0] < 110
    assert save_png(result.figure, tmp_path / "figure.png").stat().st_size > 5000


def test_an_unknown_object():
    with pytest.raises(ScenarioError, match=r"objects: unknown object 'mugg'.*mug"):
        grasp_anything.run(track, objects=["mugg"])
