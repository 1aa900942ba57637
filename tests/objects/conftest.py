import pytest

from drake_srg.scenario import load_scenario

TABLE = """
plant_config:
  time_step: 0.002
  contact_model: hydroelastic_with_fallback
  discrete_contact_approximation: lagged
directives:
- add_model: {name: table, file: package://drake_srg/sdf/table.sdf}
table: {min: [-0.4, -0.8], max: [1.3, 0.8]}
objects:
  thing:
    shape: !Cylinder {radius: 0.0125, length: 0.05}
    mass: 0.02
    friction: 0.8
    position: [0.5, 0.0]
task: {pick: thing}
"""


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Return a loader of a scenario with disturbances: a cylinder on a table."""
    path = tmp_path_factory.mktemp("scenarios") / "table.yaml"
    path.write_text(TABLE)

    def load(disturbances, *overrides):
        overrides = [f"disturbances={disturbances}", *overrides]
        return load_scenario(path, overrides=overrides)

    return load
