import pytest
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.drake_version import (
    contact_approximations,
    marks_fixed_steps,
    takes_loop_constraints,
    takes_nested_plant,
)


@pytest.mark.parametrize(
    "takes", [takes_nested_plant, takes_loop_constraints, marks_fixed_steps]
)
@pytest.mark.parametrize(
    ("version", "newer"),
    [("1.51.1", False), ("1.58.0", True), ("1.100.0", True), ("2.0.0", True)],
)
def test_cenic_depends_on_the_version_of_drake(monkeypatch, takes, version, newer):
    monkeypatch.setattr("importlib.metadata.version", lambda name: version)
    assert takes() is newer


def test_drake_takes_every_contact_approximation_that_is_listed():
    names = contact_approximations()
    assert {"lagged", "sap", "similar"} <= set(names)
    for name in names:
        config = MultibodyPlantConfig(
            time_step=0.005, discrete_contact_approximation=name
        )
        plant, _ = AddMultibodyPlant(config, DiagramBuilder())
        assert plant.time_step() == 0.005
