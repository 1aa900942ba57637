"""Objects on a table that brings them to rest, without a robot."""

from __future__ import annotations

from collections.abc import Mapping

from drake_srg.objects.config import ObjectConfig, SleepingConfig
from drake_srg.scenario import Scenario
from drake_srg.scenario.yaml_tree import parse_yaml
from drake_srg.scenario.yaml_typed import load_typed

# The contact settings that `resting` has chosen, with Drake's default stiction
# tolerance.
TABLETOP = """
plant_config:
  time_step: 0.005
  contact_model: hydroelastic_with_fallback
  discrete_contact_approximation: lagged
directives:
- add_model: {name: table, file: package://drake_srg/sdf/table_mat.sdf}
table: {min: [-0.4, -0.8], max: [1.3, 0.8]}
"""


def tabletop(
    objects: Mapping[str, ObjectConfig], sleeping: SleepingConfig | None = None
) -> Scenario:
    """Return a scenario of objects on the table."""
    tree = parse_yaml(TABLETOP, "tabletop")
    scenario: Scenario = load_typed(Scenario, tree, "tabletop")
    scenario.objects = dict(objects)
    scenario.sleeping = sleeping
    return scenario
