"""One grasp of a household object in MuJoCo, with the models that we export.

The commands, their times and the judgement are those of `grasps.simulate`.
"""

import tempfile
import time as wall_clock
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import experiments.runner as ex
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.export.files import export_scenario
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import shake
from drake_srg.types import Vector
from experiments.stands.grasps import (
    ACCELERATION,
    ARRIVE,
    CLOSE,
    FREQUENCY,
    LIFT,
    REST,
    SHAKE,
    GraspConfig,
    creep,
    stops,
)

_LIFTED = ARRIVE + CLOSE + LIFT  # s
_SHAKEN = _LIFTED + 3.0 * SHAKE + REST


def scene(scenario: Scenario) -> Any:
    """Return MuJoCo's model of a scenario, as `drake-srg export` writes it."""
    with tempfile.TemporaryDirectory() as folder:
        export_scenario(scenario, "mjcf", Path(folder))
        return mujoco.MjModel.from_xml_path(f"{folder}/scene.xml")


def change(model: Any, options: Mapping[str, Any]) -> None:
    """Replace options of an exported model.

    Args:
        model: MuJoCo's model.
        options: Fields of its `mjOption`; `condim` is that of all contacts; `harmonic`:
            pads and object meet with the harmonic mean of their coefficients of
            friction.
    """
    for name, value in options.items():
        if name == "condim":
            model.geom_condim[:] = value
        elif name == "harmonic":
            _combine_friction(model)
        else:
            setattr(model.opt, name, value)


def simulate(
    scenario: Scenario, grasp: GraspConfig, options: Mapping[str, Any], hold: float
) -> ex.Measures:
    """Grasp the object of a scenario in MuJoCo, lift it, shake it, and hold it.

    Args:
        scenario: Scenario of `grasps.present`.
        grasp: The grasp.
        options: See `change`.
        hold: Time that the hand waits at the end [s].

    Returns:
        `slip`, `creep` and `wall`, as from `grasps.simulate`.
    """
    model = scene(scenario)
    change(model, options)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    names = [model.actuator(i).name for i in range(model.nu)]
    arm = [i for i, name in enumerate(names) if name.startswith("arm_")]
    wire = names.index("wire_motor")
    limit = scenario.gripper.wire_motor.drive.force_limit_of(grasp.wire_force)
    command = _commands(scenario, grasp)
    palm, thing = (data.body(name) for name in ("gripper_palm", body_name(model)))
    time, p_GO = [], []
    start = wall_clock.perf_counter()
    while data.time < _SHAKEN + hold:
        data.ctrl[arm] = command(data.time)
        data.ctrl[wire] = limit if data.time > ARRIVE else 0.0
        mujoco.mj_step(model, data)
        if data.time > _LIFTED:
            time.append(data.time)
            p_GO.append(palm.xmat.reshape(3, 3).T @ (thing.xpos - palm.xpos))
    wall = (wall_clock.perf_counter() - start) / data.time
    shaken = np.searchsorted(time, _SHAKEN)
    return {
        "slip": 1e3 * float(np.linalg.norm(p_GO[shaken] - p_GO[0])),
        "creep": creep(np.array(time), np.array(p_GO), 0.8 * hold),
        "wall": wall,
    }


def _combine_friction(model: Any) -> None:
    """Set the friction that Drake would use on everything that touches the object."""
    own = np.array(model.geom_bodyid) == model.body(body_name(model)).id
    thing = own & (np.array(model.geom_contype) > 0)  # not what is only seen
    friction = model.geom_friction
    theirs = friction[thing, 0].max()
    ours = friction[~thing, 0]
    friction[~thing, 0] = 2.0 * ours * theirs / (ours + theirs)
    friction[thing, 0] = 0.0  # MuJoCo takes the larger one


def body_name(model: Any) -> str:
    """Return the name of the object's body."""
    names = [model.body(i).name for i in range(model.nbody)]
    return next(name for name in names if name.startswith("thing"))


def _commands(scenario: Scenario, grasp: GraspConfig) -> Any:
    """Return the gantry's commanded position [m] as a function of time [s]."""
    home = np.array(scenario.arm.home)
    there, above = stops(scenario, grasp)
    shakes = [shake(above, ACCELERATION * x, FREQUENCY, SHAKE) for x in np.eye(3)]

    def command(t: float) -> Vector:
        if t < _LIFTED:
            arrival = minimum_jerk_blend(t / ARRIVE) * (there - home)
            lift = minimum_jerk_blend((t - ARRIVE - CLOSE) / LIFT) * (above - there)
            return home + arrival + lift
        i = int((t - _LIFTED) // SHAKE)
        return shakes[i](t - _LIFTED - i * SHAKE) if i < len(shakes) else above

    return command
