"""Plants of a scenario's models."""

import os

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

FRAME = """directives:
- add_frame: {{name: tip, X_PF: {{base_frame: world, translation: [{x}, 0, 0]}}}}
"""


def test_the_models_plant_has_the_models_but_no_object():
    plant = MakeModelsPlant(load_scenario("kitchen"))
    assert plant.is_finalized()
    assert plant.HasModelInstanceNamed("arm")
    assert not plant.HasModelInstanceNamed("soup_can")


def test_seeds_share_a_models_plant():
    plants = [MakeModelsPlant(load_scenario("kitchen", seed=seed)) for seed in (0, 1)]
    assert plants[0] is plants[1]
    assert plants[0] is not MakeModelsPlant(load_scenario("kitchen_fast"))


@pytest.mark.slow
def test_changed_directives_are_read_again(tmp_path):
    path = tmp_path / "frames.dmd.yaml"
    override = f"directives.floor={{add_directives: {{file: {path.as_uri()}}}}}"
    for x in (0.1, 0.2):
        path.write_text(FRAME.format(x=x))
        plant = MakeModelsPlant(load_scenario("kitchen", overrides=[override]))
        frame = plant.GetFrameByName("tip")
        assert frame.GetFixedPoseInBodyFrame().translation()[0] == x


@pytest.mark.slow
def test_changed_models_are_read_again(tmp_path):
    path = tmp_path / "ball.sdf"
    override = f"directives.floor={{add_model: {{name: ball, file: {path.as_uri()}}}}}"
    model = '<sdf version="1.9"><model name="ball"><link name="{}"/></model></sdf>'
    for i, link in enumerate(("red", "green")):
        path.write_text(model.format(link))
        os.utime(path, ns=(i, i))  # file systems have coarse clocks
        plant = MakeModelsPlant(load_scenario("kitchen", overrides=[override]))
        assert plant.HasBodyNamed(link)


def test_a_missing_file_is_reported():
    scenario = load_scenario(
        "kitchen",
        overrides=["directives.table={add_directives: {file: file:///no.yaml}}"],
    )
    with pytest.raises(ScenarioError, match=r"directives: .*no\.yaml"):
        MakeModelsPlant(scenario)
