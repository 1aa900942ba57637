"""Scenarios exported once for all tests, and the plants that they come from."""

import functools
import tempfile
from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.export import export_scenario
from drake_srg.scenario import load_scenario

_FOLDER = tempfile.TemporaryDirectory(prefix="drake_srg_export_")  # goes with the tests
# One with wires, and one gripper each with mimic joints and with loops.
GRIPPERS = {"mimics": "linkage_gripper_fast", "loops": "linkage_gripper"}
SCENARIOS = ("kitchen_tendon", *GRIPPERS)


@functools.cache
def exported(name, kind):
    """Return the exported models of a scenario by their names."""
    out = Path(_FOLDER.name) / f"{name}_{kind}"
    if name in GRIPPERS:
        model = f"{{name: gripper, file: package://drake_srg/sdf/{GRIPPERS[name]}.sdf}}"
        path = Path(_FOLDER.name) / f"{name}.yaml"
        path.write_text(f"directives:\n- add_model: {model}\n")
        scenario = load_scenario(str(path))
    else:
        scenario = load_scenario(name)
    files = export_scenario(scenario, kind, out)
    return {each.model.name: each for each in files}


def parsed(path):
    """Return the plant that Drake makes of a URDF or SDF file, finalized."""
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    Parser(plant).AddModels(str(path))
    plant.Finalize()
    return plant
