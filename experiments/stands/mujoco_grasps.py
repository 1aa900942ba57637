"""The bench in MuJoCo, with the models that we export, and one grasp of an object."""

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
from experiments.stands import grasps

_LIFTED = grasps.ARRIVE + grasps.CLOSE + grasps.LIFT  # s
_SHAKEN = _LIFTED + 3.0 * grasps.SHAKE + grasps.REST


class MujocoBench:
    """The hand of a scenario with its gantry and, if it has one, its object.

    `options` replace fields of MuJoCo's `mjOption`; `condim` is that of all contacts;
    `harmonic`: what touches the object meets it with Drake's coefficient of friction,
    the harmonic mean of both.
    """

    def __init__(self, scenario: Scenario, options: Mapping[str, Any]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            export_scenario(scenario, "mjcf", Path(folder))
            model = mujoco.MjModel.from_xml_path(f"{folder}/scene.xml")
        self.model, self.data = model, mujoco.MjData(model)
        names = [model.actuator(i).name for i in range(model.nu)]
        self._arm = [i for i, name in enumerate(names) if name.startswith("arm_")]
        self.wire = names.index("wire_motor")
        self._palm = self.data.body("gripper_palm")
        bodies = [model.body(i).name for i in range(model.nbody)]
        things = [name for name in bodies if name.startswith("thing")]
        self.thing = self.data.body(things[0]) if things else None
        for name, value in options.items():
            if name == "condim":
                model.geom_condim[:] = value
            elif name == "harmonic":
                self._combine_friction()
            else:
                setattr(model.opt, name, value)
        mujoco.mj_resetDataKeyframe(model, self.data, 0)

    def _combine_friction(self) -> None:
        own = np.array(self.model.geom_bodyid) == self.thing.id
        thing = own & (np.array(self.model.geom_contype) > 0)  # not what is only seen
        friction = self.model.geom_friction
        theirs, ours = friction[thing, 0].max(), friction[~thing, 0]
        friction[~thing, 0] = 2.0 * ours * theirs / (ours + theirs)
        friction[thing, 0] = 0.0  # MuJoCo takes the larger one

    def close(self, limit: float) -> None:
        """Close the fingers with a fraction of full PWM."""
        self.data.ctrl[self.wire] = limit

    def step(self, arm: Vector) -> None:
        """Simulate a time step with the gantry commanded to `arm` (3) [m]."""
        self.data.ctrl[self._arm] = arm
        mujoco.mj_step(self.model, self.data)

    def p_GO(self) -> Vector:
        """Return the object's place in the hand (3) [m]."""
        R_GW = self._palm.xmat.reshape(3, 3).T
        p_GO: Vector = R_GW @ (self.thing.xpos - self._palm.xpos)
        return p_GO


def simulate(
    scenario: Scenario,
    grasp: grasps.GraspConfig,
    options: Mapping[str, Any],
    hold: float,
) -> ex.Measures:
    """Grasp, lift, shake and hold as `grasps.simulate`: `slip`, `creep` and `wall`."""
    bench = MujocoBench(scenario, options)
    limit = scenario.gripper.wire_motor.drive.force_limit_of(grasp.wire_force)
    home = np.array(scenario.arm.home)
    there, above = grasps.stops(scenario, grasp)
    shakes = [
        shake(above, grasps.ACCELERATION * axis, grasps.FREQUENCY, grasps.SHAKE)
        for axis in np.eye(3)
    ]

    def command(t: float) -> Vector:
        """Return the gantry's commanded position [m]."""
        if t < _LIFTED:
            arrival = minimum_jerk_blend(t / grasps.ARRIVE) * (there - home)
            rise = minimum_jerk_blend((t - grasps.ARRIVE - grasps.CLOSE) / grasps.LIFT)
            return home + arrival + rise * (above - there)
        i = int((t - _LIFTED) // grasps.SHAKE)
        return shakes[i](t - _LIFTED - i * grasps.SHAKE) if i < len(shakes) else above

    time, p_GO = [], []
    start = wall_clock.perf_counter()
    while bench.data.time < _SHAKEN + hold:
        bench.close(limit if bench.data.time > grasps.ARRIVE else 0.0)
        bench.step(command(bench.data.time))
        if bench.data.time > _LIFTED:
            time.append(bench.data.time)
            p_GO.append(bench.p_GO())
    shaken = np.searchsorted(time, _SHAKEN)
    return {
        "slip": 1e3 * float(np.linalg.norm(p_GO[shaken] - p_GO[0])),
        "creep": grasps.creep(np.array(time), np.array(p_GO), 0.8 * hold),
        "wall": (wall_clock.perf_counter() - start) / bench.data.time,
    }
