"""Scenarios: the schema of scenario files, and how to load one."""

from drake_srg.scenario.load import (
    SCENARIOS,
    Drawn,
    draw_scenario,
    list_scenarios,
    load_scenario,
    load_tree,
)
from drake_srg.scenario.schema import (
    LocalizerConfig,
    PlaceConfig,
    RecordingConfig,
    RegionConfig,
    Scenario,
    TableConfig,
    TaskConfig,
    is_continuous,
    perception_cameras,
    script_of,
    servo_of,
)

__all__ = [
    "SCENARIOS",
    "Drawn",
    "LocalizerConfig",
    "PlaceConfig",
    "RecordingConfig",
    "RegionConfig",
    "Scenario",
    "TableConfig",
    "TaskConfig",
    "draw_scenario",
    "is_continuous",
    "list_scenarios",
    "load_scenario",
    "load_tree",
    "perception_cameras",
    "script_of",
    "servo_of",
]
