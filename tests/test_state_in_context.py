"""Systems keep all state in the Context, and nothing keeps them when it is gone."""

import functools
import types
import weakref

import numpy as np
import pytest

from drake_srg.common.systems import MakeSimulator, output_ports
from drake_srg.lifetime import my_context
from drake_srg.scenario import load_scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.station import MakeCell
from drake_srg.station.cell import AddCell


def snapshot(value, seen):
    """Return what a value holds, as far as the package's own code could change it.

    What has been seen, by its id, is not looked into again.
    """
    match value:
        case bool() | int() | float() | str() | None:
            return value
        case _ if id(value) in seen:
            return "seen"
    seen[id(value)] = value  # so that no other gets its id
    match value:
        case np.ndarray():
            result = value.dtype.str, value.shape, value.tobytes()
        case dict():
            result = [(str(key), snapshot(v, seen)) for key, v in value.items()]
        case list() | tuple():
            result = [snapshot(item, seen) for item in value]
        case set() | frozenset():
            result = sorted(map(str, value))
        case types.FunctionType() | types.MethodType() | type():
            result = "code"
        case _ if type(value).__module__.startswith("drake_srg"):
            # What a frozen object has derived from itself says nothing new.
            lazy = {
                name
                for kind in type(value).__mro__
                for name, item in vars(kind).items()
                if isinstance(item, functools.cached_property)
            }
            own = getattr(value, "__dict__", None) or {}
            result = snapshot({k: v for k, v in own.items() if k not in lazy}, seen)
        case _:
            result = type(value).__name__
    return result


def own_systems(diagram):
    """Yield the systems of the package in a diagram, at any depth, with their names."""
    for system in diagram.GetSystems():
        if hasattr(system, "GetSystems"):
            yield from own_systems(system)
        elif hasattr(system, "__dict__"):
            yield system.GetSystemPathname(), system


@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        (
            "kitchen",
            [
                *("safety={}", "sleeping={}", "gripper.trigger=touch"),
                "disturbances=[!Push {at: grasp}]",
            ],
        ),
        ("kitchen_varied", []),
        ("kitchen_tendon", ["gripper.drive.dead_band=0.1"]),
        ("kitchen_impedance", []),
        ("insert", []),
        ("handover", []),
        ("carry_together", []),
        ("assistive_arm", ["gripper.errors={latency: 0.01, encoder_noise: 1.0e-4}"]),
        ("clear_table", []),
        ("clear_table_together", []),
        ("conveyor", []),
        ("thesis_kitchen", []),
        ("assistive_arm_thesis", []),
    ],
)
def test_a_simulation_changes_no_system_and_its_end_frees_all(
    leaked, scenario, overrides
):
    changed, watches = simulated(scenario, overrides)
    assert not changed
    assert len(leaked.made) <= len(watches) > 5
    assert leaked() == []
    assert [watch for watch in watches if watch() is not None] == []


def simulated(scenario, overrides):
    """Return the names of systems that a simulation changed, and references to all."""
    config = load_scenario(scenario, overrides=overrides)
    builder, cell = MakeRoot("cell", MakeCell, AddCell, config, scenario)
    root = builder.Build()
    simulator = MakeSimulator(root, config.simulator_config)  # as every run does
    systems = dict(own_systems(root))
    before = {name: snapshot(vars(system), {}) for name, system in systems.items()}
    planned = {
        "clear_table": 1.5,
        "clear_table_together": 1.5,
        "conveyor": 2.5,
    }  # when plans are made [s]
    simulator.AdvanceTo(planned.get(scenario, 0.15))
    context = my_context(cell, simulator.get_context())
    for name, port in output_ports(cell).items():
        if not name.startswith("camera"):
            port.Eval(context)
    after = {name: snapshot(vars(system), {}) for name, system in systems.items()}
    changed = [name for name in systems if before[name] != after[name]]
    return changed, list(map(weakref.ref, systems.values()))
