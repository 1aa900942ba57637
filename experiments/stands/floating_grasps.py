"""Drawn grasps of floating objects, closed and shaken alike in Drake and in MuJoCo.

The object floats in front of the open hand, so that it may be grasped from anywhere.
Meanwhile, a viscous medium hinders it: the finger that arrives first would kick it out
of the hand. Once the fingers stand still, it gets its weight, and the gantry shakes the
hand. The procedure is written once, for `InDrake` and `InMujoco`.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import time
from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

import experiments.runner as ex
from drake_srg.learning.grasp_bench import HANDS
from drake_srg.objects.household import household_object, object_facts
from drake_srg.objects.solids import object_pieces
from drake_srg.planning.grasps.sampled_grasps import SampledGrasp, sample_grasps
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario, shake
from drake_srg.types import Vector
from experiments.stands.grasps import MIDDLE
from experiments.stands.holding import body_of
from experiments.stands.mujoco_grasps import MujocoBench

# Of the palm, in which the hand points down or to the front [degrees].
_HANDS = ([0.0, 90.0, 0.0], [0.0, 0.0, 0.0])
_HOME = np.array([0.0, 0.0, 0.6])  # of the gantry: nothing reaches the table [m]
# As in `grasp_measures`: shares of wire force and mass, coefficient of friction, and
# the shake [s, Hz, m/s²]. The middle wire force of data/grasps.yaml is 120 N. With less
# than half of it, the motor takes more than 4 s to close the open hand.
_WIRE_FORCE, _FORCE, _MASS, _FRICTION = 120.0, (0.5, 1.2), (0.5, 2.5), (0.3, 0.9)
_SHAKE, _FREQUENCY, _STRENGTH = 1.25, 4.0, (5.0, 30.0)
# The fingers close until they touch the object and stand still [s, rad/s]. While a
# slack wire is wound up, they stand still, too.
_MOST_CLOSE, _CHECK, _STILL = 4.0, 0.1, 0.02
# In which the medium stops the floating object [s]: at 0.1 m/s, it pushes with half of
# the weight, as a table's friction would.
_STOP = 0.02
# With the weight alone, before the shake and after it; creep is that of the end [s].
_REST, _AFTER, _END = 0.1, 0.3, 0.1
_LOOK = 0.05  # how often the object's place is judged [s]
LOST = 0.015  # motion in the hand that loses the object [m]
_HOPELESS = 40  # directions without a grasp


@dc.dataclass(frozen=True, eq=False)
class Shake:
    """A drawn grasp of an object, and how it is shaken."""

    grasp: SampledGrasp
    rpy: list[float]  # roll, pitch, yaw of the palm [degrees]
    mass: float  # of the object [kg]
    friction: float  # of the object
    wire_force: float  # of each wire [N]
    a_W: Vector  # greatest acceleration of the hand (3) [m/s²]

    def scenario(self, name: str, scenario: str, overrides: Any = ()) -> Scenario:
        """Return the bench with the object in front of the open hand."""
        thing = household_object(name)
        R_WG = RollPitchYaw(np.deg2rad(self.rpy)).ToRotationMatrix()
        X_WO = RigidTransform(R_WG, MIDDLE + _HOME) @ self.grasp.X_OG.inverse()
        thing.pose = Transform(X_WO)
        thing.mass, thing.friction = self.mass, self.friction
        return bench_scenario(
            thing,
            gripper_rpy=self.rpy,
            home=[*_HOME],
            scenario=scenario,
            overrides=overrides,
        )


@functools.lru_cache(maxsize=1)  # the engines of one shake follow each other
def draw(name: str, number: int) -> Shake:
    """Return the shake of an object with a number, from 0."""
    rng = np.random.default_rng([number, *name.encode()])
    thing = household_object(name)
    solid, p_OC = object_pieces(name, thing)
    solid = solid.translated(p_OC)
    fingers, seed = HANDS["srg"].fingers, int(rng.integers(2**31))
    samples = (sample_grasps(fingers, solid, seed, k) for k in range(_HOPELESS))
    some = next(found for found in samples if found)
    direction = rng.normal(size=3)
    direction *= rng.uniform(*_STRENGTH) / np.linalg.norm(direction)
    mass, force = (float(np.exp(rng.uniform(*np.log(s)))) for s in (_MASS, _FORCE))
    return Shake(
        some[int(rng.integers(len(some)))],
        _HANDS[int(rng.integers(2))],
        object_facts(name, thing).mass * mass,
        float(rng.uniform(*_FRICTION)),
        _WIRE_FORCE * force,
        direction,
    )


def judge(engine: InDrake | InMujoco, drawn: Shake, limit: float) -> ex.Measures:
    """Close with a fraction of full PWM, weigh and shake the object.

    Return `touched`: whether the open hand touches the object, which ends the trial;
    `held`; of an object that is held, `moved` in the hand [mm], `creep` at the end
    [um/s], `depth` to which pads and object overlap before the shake [mm]; `wall` [s].
    """
    begin = time.process_time()

    def still(t: float) -> Vector:
        return _HOME

    def end(**found: Any) -> ex.Measures:
        wall = time.process_time() - begin
        return {"touched": False, "held": False, "wall": wall} | found

    engine.levitate(True)
    if engine.depths():
        return end(touched=True)
    engine.close(limit)
    for _ in range(round(_MOST_CLOSE / _CHECK)):
        engine.advance(_CHECK, still)
        depths = engine.depths()
        if depths and engine.finger_speed() < _STILL:
            break
    start = engine.p_GO()
    if not depths:
        return end()
    engine.levitate(False)
    shaken = shake(_HOME, drawn.a_W, _FREQUENCY, _SHAKE)

    def arm(since: float, t: float) -> Vector:
        return shaken(min(max(since + t - _REST, 0.0), _SHAKE))

    count = round((_REST + _SHAKE + _AFTER) / _LOOK)
    for i in range(count):
        engine.advance(_LOOK, functools.partial(arm, i * _LOOK))
        if np.linalg.norm(engine.p_GO() - start) > LOST:
            return end()
        if i == count - 1 - round(_END / _LOOK):
            before = engine.p_GO()
    moved = engine.p_GO() - start
    return end(
        held=True,
        moved=1e3 * float(np.linalg.norm(moved)),
        creep=1e6 * float(np.linalg.norm(engine.p_GO() - before)) / _END,
        depth=1e3 * max(depths),
    )


class InDrake:
    """A rig with the open hand in front of the object."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._body = body_of(rig, rig.scenario.task.pick)
        self._shapes = set(rig.plant.GetCollisionGeometriesForBody(self._body))
        self._gripper = rig.plant.GetModelInstanceByName("gripper")
        port = rig.diagram.GetInputPort("object_forces_cheat")
        self._forces = port.FixValue(
            rig.context, AbstractValue.Make([ExternallyAppliedSpatialForce()])
        )
        self._floats = False

    def levitate(self, floats: bool) -> None:
        """Let the object float in the medium, or no longer."""
        self._floats = floats
        self._push()

    def _push(self) -> None:
        context, applied = self._rig.plant_context, ExternallyAppliedSpatialForce()
        applied.body_index = self._body.index()
        applied.p_BoBq_B = p_OC = self._body.CalcCenterOfMassInBodyFrame(context)
        if self._floats:
            R_WO = self._body.EvalPoseInWorld(context).rotation()
            V_WO = self._body.EvalSpatialVelocityInWorld(context)
            I_O = self._body.CalcSpatialInertiaInBodyFrame(context)
            I_C = I_O.Shift(p_OC).CalcRotationalInertia().ReExpress(R_WO)
            V_WC = V_WO.Shift(R_WO @ p_OC)
            weight = np.array([0.0, 0.0, 9.81])
            applied.F_Bq_W = SpatialForce(
                tau=-I_C.CopyToFullMatrix3() @ V_WC.rotational() / _STOP,
                f=I_O.get_mass() * (weight - V_WC.translational() / _STOP),
            )
        self._forces.GetMutableData().set_value([applied])

    def close(self, limit: float) -> None:
        """Close the fingers with a fraction of full PWM."""
        self._rig.fix("gripper.closure_commanded", 1.0)
        self._rig.fix("gripper.force_limit", limit)

    def advance(self, duration: float, arm: Callable[[float], Vector]) -> None:
        """Simulate for a while [s]; `arm` is the gantry's place by the time in it."""

        def command(t: float) -> Vector:
            if self._floats:
                self._push()
            return arm(t)

        self._rig.advance(duration, arm=command)

    def p_GO(self) -> Vector:
        """Return the object's place in the palm (3) [m]."""
        p_GO: Vector = self._rig.X_GO().translation()
        return p_GO

    def finger_speed(self) -> float:
        """Return the greatest speed of a finger joint [rad/s]."""
        plant, context = self._rig.plant, self._rig.plant_context
        return float(np.abs(plant.GetVelocities(context, self._gripper)).max())

    def depths(self) -> list[float]:
        """Return how deep each contact with the object is, in rigid shapes [m]."""
        port = self._rig.plant.get_geometry_query_input_port()
        query = port.Eval(self._rig.plant_context)
        pairs = query.ComputePointPairPenetration()
        return [p.depth for p in pairs if {p.id_A, p.id_B} & self._shapes]


def in_drake(drawn: Shake, bench: Scenario) -> ex.Measures:
    """Judge a shake on the bench, in Drake."""
    limit = bench.gripper.wire_motor.drive.force_limit_of(drawn.wire_force)
    with Rig(bench, name="floating_grasp", log_period=1.0) as rig:
        return judge(InDrake(rig), drawn, limit)


class InMujoco(MujocoBench):
    """The same in MuJoCo, with the methods of `InDrake`."""

    def __init__(self, scenario: Scenario, options: Mapping[str, Any]) -> None:
        super().__init__(scenario, options)
        mujoco.mj_forward(self.model, self.data)
        first = self.model.body_dofadr[self.thing.id]
        self._dofs = slice(first, first + 6)
        hinges = np.array(self.model.jnt_type) == mujoco.mjtJoint.mjJNT_HINGE
        self._fingers = np.array(self.model.jnt_dofadr)[hinges]

    def levitate(self, floats: bool) -> None:
        # A free joint turns in the axes of the body, near those of its inertia.
        body = self.model.body(self.thing.id)
        mass, inertia = float(body.mass[0]), body.inertia.max()
        self.thing.xfrc_applied[2] = floats * 9.81 * mass
        damping = np.repeat([mass, inertia], 3) / _STOP
        self.model.dof_damping[self._dofs] = floats * damping

    def advance(self, duration: float, arm: Callable[[float], Vector]) -> None:
        step = self.model.opt.timestep
        for i in range(round(duration / step)):
            self.step(arm(i * step))

    def finger_speed(self) -> float:
        return float(np.abs(self.data.qvel[self._fingers]).max())

    def depths(self) -> list[float]:
        contacts = self.data.contact
        bodies = np.array(self.model.geom_bodyid)[contacts.geom]
        own = (bodies == self.thing.id).any(axis=-1) & (contacts.dist < 0.0)
        return [-float(d) for d in contacts.dist[own]]


def in_mujoco(drawn: Shake, bench: Scenario, options: Mapping[str, Any]) -> ex.Measures:
    """Judge a shake on the exported bench; for `options`, see `MujocoBench`."""
    limit = bench.gripper.wire_motor.drive.force_limit_of(drawn.wire_force)
    return judge(InMujoco(bench, options), drawn, limit)
