"""A finite-element sponge, grasped, lifted and held with a gentle and a strong pull.

The gripper closes on a block of foam that stands on the table. The foam's elasticity
and the wires' moments about the base hinges determine the expected squeeze and grip
force. The block is at least as stiff as the column between the pads if this could bulge
freely. It is at most as stiff as a block that is squeezed uniformly and cannot bulge.
Half the time step, or a finer mesh, may change the squeeze by a tenth.
"""

from typing import Any

import numpy as np
from pydrake.multibody.tree import DeformableBody

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper import JOINT_NAMES
from drake_srg.gripper.tendon import TendonDriveConfig, base_moment_arm
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import object_body
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Vector
from experiments.stands.holding import in_hand, is_free

# A piece of a dry kitchen sponge: x, y (across the hand) and z [m], density [kg/m³],
# the stiffness of `SoftConfig`, and friction of foam on rubber, within the 0.2 to 3 of
# polyurethanes.
SIZE, DENSITY, FOAM, FRICTION = [0.04, 0.06, 0.045], 30.0, SoftConfig(), 0.6
# Middle of a pad's flat face in the tip's frame [m], and its distance from the base
# hinge with the tip straight.
PAD_MIDDLE = [SRG.pad_middle, SRG.face_offset, 0.0]
LEVER = SRG.base_length + SRG.pad_middle
# Height of the hand. With parallel fingers, the lower ends of the pads are `CLEARANCE`
# above the table, and the upper ends as much above the sponge [m].
HEIGHT, CLEARANCE = 0.1854, 0.002
# The fingers close and the force settles; the arm lifts; it holds still [s].
CLOSE, LIFT, HOLD = 5.0, 1.0, 5.0
LIFT_HEIGHT = 0.06  # m
_SAMPLE = 0.05  # s
# The sponge counts as held while it moves less than this in the hand [m].
MOST_CREEP = 0.005


def cases() -> list[ex.Case]:
    """Grasp with both pulls, with half the time step and a finer mesh, and with a ramp.

    45 N at each wire is just enough to close the hand in time; 103 N is the default.
    """
    # The longest step that soft bodies allow [s], a fast mesh of 3 x 4 x 3 cells [m],
    # and the time in which the pull grows up to the servo's limit after the hold [s].
    common = {"wire_force": 103.0, "time_step": 0.005, "mesh": 0.015, "ramp": 0.0}
    changes: dict[str, ex.Case] = {
        "gentle": {"wire_force": 45.0},
        "strong": {},
        "half the step": {"time_step": 0.0025},
        "finer mesh": {"mesh": 0.0113},
        "ramp": {"ramp": 8.0},
    }
    return [{"name": name} | common | change for name, change in changes.items()]


def trial(
    name: str, wire_force: float, time_step: float, mesh: float, ramp: float
) -> ex.Measures:
    """Close on the sponge, lift it, hold it and, with a ramp, pull ever harder."""
    thing = ObjectConfig(
        shape=Box(SIZE),
        soft=FOAM,
        mass=DENSITY * float(np.prod(SIZE)),
        friction=FRICTION,
        resolution=mesh,
        color=[0.95, 0.75, 0.2],
    )
    overrides = [f"plant_config.time_step={time_step}", f"arm.period={time_step}"]
    if ramp:  # lets the spool wind farther than it takes to close an empty hand
        overrides.append("gripper.spool.full_scale=5")
    scenario = bench_scenario(thing, home=[0.0, 0.0, HEIGHT], overrides=overrides)
    limit = scenario.gripper.wire_motor.drive.force_limit_of(wire_force)
    least = np.inf
    with Rig(scenario, name="soft", log_period=_SAMPLE) as rig:
        elements = Elements(rig)

        def advance(duration: float, **commands: Any) -> None:
            nonlocal least
            for _ in range(round(duration / 0.5)):
                rig.advance(0.5, **commands)
                least = min(least, elements.least_volume())

        advance(CLOSE, closure=1.0, force_limit=limit)
        rig.move([0.0, 0.0, HEIGHT + LIFT_HEIGHT], LIFT)
        lifted = float(elements.vertices()[2].min())
        free = is_free(rig)
        advance(1.0 if ramp else HOLD)
        q, spring = rig.measured("gripper.state_measured")[:2], TendonDriveConfig()
        back = spring.base_spring.preload + spring.base_spring.stiffness * q
        # The grip force that balances the wires at the base hinges [N].
        moment = rig.measured("gripper.wire_force") * base_moment_arm(q) - back
        if ramp:
            rig.advance(ramp, force_limit=lambda t: limit + (1.0 - limit) * t / ramp)
        log = rig.log()
        squeeze = 1.0 - pad_gap(rig, log["gripper.state_measured"]) / SIZE[1]
    p_GO = in_hand(log)
    time, force = log["time"], log["gripper.contact_force"][:, 2:].mean(axis=1)
    start = int(np.argmin(np.abs(time - CLOSE - LIFT)))
    moved = np.linalg.norm(p_GO - p_GO[start], axis=1)
    found = {"time [s]": time, "squeeze": squeeze, "grip force [N]": force}
    if ramp:
        after = time > CLOSE + LIFT
        out = moved[after] > MOST_CREEP
        until = slice(int(np.argmax(out)) if out.any() else None)
        word = "when squeezed out" if out.any() else "while still held"
        wire = log["gripper.wire_force"].mean(axis=1)
        return found | {
            f"grip force {word} [N]": max(force[after][until]),
            f"wire force {word} [N]": max(wire[after][until]),
            f"squeeze {word} [of the width]": max(squeeze[after][until]),
        }
    end = CLOSE + LIFT + HOLD
    resting = (time > end - 1.0) & (time < end + 1e-6)
    after = time >= CLOSE + LIFT - 1e-9
    lost = np.flatnonzero(moved[after] > MOST_CREEP)
    held_for = time[after][lost[0]] - CLOSE - LIFT if len(lost) else HOLD
    last = time > end - 1.0
    return found | {
        "at rest": squeeze[resting].mean(),
        "force at rest": force[resting].mean(),
        "expected force": np.mean(moment) / LEVER,
        "lifted off the table by [mm]": lifted * 1e3,
        "held for [s]": held_for if free else 0.0,
        "creep in the last second [mm/s]": 1e3
        * np.ptp(moved[last])
        / np.ptp(time[last]),
        "smallest volume of an element [of its free volume]": least,
    }


class Elements:
    """The vertices and tetrahedra of a rig's sponge."""

    def __init__(self, rig: Rig) -> None:
        body = object_body(rig.plant, rig.plant.GetModelInstanceByName("thing"))
        assert isinstance(body, DeformableBody)
        inspector = rig.station.GetSubsystemByName("scene_graph").model_inspector()
        mesh = inspector.GetReferenceMesh(body.geometry_id())
        self._body, self._context = body, rig.plant_context
        self._corners = np.array(
            [[t.vertex(i) for i in range(4)] for t in mesh.tetrahedra()]
        )
        self._free = self._volumes(body.reference_positions().reshape(-1, 3).T)

    def vertices(self) -> Vector:
        """Return the vertices in world, shape (3, n) [m]."""
        return np.array(self._body.GetPositions(self._context))

    def least_volume(self) -> float:
        """Return the smallest volume over the free one; inverted, it is below 0."""
        return float(np.min(self._volumes(self.vertices()) / self._free))

    def _volumes(self, p: Vector) -> Vector:
        a, b, c, d = (p[:, i].T for i in self._corners.T)
        volumes: Vector = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
        return volumes


def pad_gap(rig: Rig, state: Vector) -> Vector:
    """Return the distance between the pads' middles (K,) [m] in states (K, 8)."""
    plant, context = rig.plant, rig.plant.CreateDefaultContext()
    gripper = plant.GetModelInstanceByName("gripper")
    joints = [plant.GetJointByName(name, gripper) for name in JOINT_NAMES]
    tips = [plant.GetFrameByName(f"{s}_tip_link", gripper) for s in ("left", "right")]
    gaps = []
    for q in state[:, : len(joints)]:
        for joint, angle in zip(joints, q, strict=True):
            joint.set_angle(context, angle)
        left, right = (frame.CalcPoseInWorld(context) @ PAD_MIDDLE for frame in tips)
        gaps.append(np.linalg.norm(left - right))
    return np.array(gaps)


def elasticity(trials: ex.Trials) -> dict[str, ex.Values]:
    e, nu = FOAM.youngs_modulus, FOAM.poissons_ratio
    confined = e * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    column, side = SRG.pad_width * (SIZE[2] - CLEARANCE), SIZE[0] * SIZE[2]
    found: dict[str, ex.Values] = {}
    named = {t["name"]: t for t in trials}
    for name in ("gentle", "strong"):
        squeeze, force = named[name]["at rest"], named[name]["force at rest"]
        # The foam may press off the pads' middles by a tenth of the lever.
        statics = ex.within(named[name]["expected force"], relative=0.1)
        about = ex.within(force / (e * side), relative=0.2)
        found[name] = {
            f"squeeze, {what} [of the width]": (squeeze, bound)
            for what, bound in (
                ("at most F / (E A_pad)", ex.at_most(force / (e * column))),
                ("at least F / (M A_side)", ex.at_least(force / (confined * side))),
                ("about F / (E A_side)", about),
            )
        } | {"grip force, from the wire force [N]": (force, statics)}
    strong = named["strong"]["at rest"]
    more = strong - named["gentle"]["at rest"]
    found["strong - gentle"] = {"squeeze [of the width]": (more, ex.at_least(0.1))}
    for name in ("half the step", "finer mesh"):
        same = (named[name]["at rest"], ex.within(strong, relative=0.1))
        found[name] = {"squeeze, same as strong [of the width]": same}
    return found


soft = ex.Experiment(
    "A finite-element sponge, grasped, lifted and held gently and strongly.",
    cases,
    trial,
    {
        "lifted off the table by": ex.at_least(1e3 * (LIFT_HEIGHT - MOST_CREEP)),
        "held for": ex.at_least(HOLD),
        "creep in the last second": ex.at_most(0.1),
        "smallest volume of an element": ex.at_least(0.0),
    },
    whole=elasticity,
    picture=[ex.Curves("time [s]", "grip force [N]"), ex.Curves("time [s]", "squeeze")],
)
