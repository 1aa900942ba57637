"""Joint angles of a finger that closes on nothing against the force of its wire.

The complete driver winds its wires step by step and waits for rest, so that wire force
and angles balance. As in the vendor's MuJoCo model, there is neither gravity nor
contact. The finger closes once with the vendor's stops and once with ours. The base
must close to its stop before the tip starts.
"""

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.tendon import base_moment_arm, tip_moment_arm
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector
from experiments.data import read_csv

# Upper stops of base and tip [rad]: of the MuJoCo model and of SAKE's URDF.
VENDOR, OURS = "vendor's stops", "our stops"
STOPS = {VENDOR: (2.0068, 1.745), OURS: (SRG.joint_limit, SRG.joint_limit)}
# Of the spool, and into which the one is divided in which the tip starts.
STEPS, FINE_STEPS = 150, 30
# Time to come to rest. The motor settles as exp(-24 t), the slower pole of its loop. A
# finger on a slack spring, whose force hardly changes with the angle, takes longer [s].
SETTLE = 1.0
# Command beyond the tip's stop [rad], because the wires stretch and the servo yields.
_EXCESS = 0.5
# Smaller angles count as this one: the vendor's angles come in steps of 0.05 degrees,
# and 3 % of this angle is about two of them [rad].
SMALL = np.deg2rad(3.0)
# One count of a 12-bit encoder: a joint this close to 0 or a stop is there [rad].
_COUNT = 2.0 * np.pi / 4096.0
_TIP = FINGERS[0][1]
THREE_PERCENT = ex.at_most(3.0, source="vendor's model")


def trial(stops: str) -> ex.Measures:
    """Wind the wires in equal steps until both joints are at their stops."""
    limits = STOPS[stops]
    full_scale = sum(STOPS[VENDOR]) + _EXCESS
    spool = f"{{full_scale: {full_scale}, base_limit: {limits[0]}}}"
    scenario = bench_scenario(
        overrides=[f"gripper=!SrgTendonDriver {{spool: {spool}}}"]
    )
    scenario.objects, scenario.task.pick = {}, ""
    with Rig(scenario, name="free_closing") as rig:
        free_the_fingers(rig, limits)

        def settle(closure: float) -> Vector:
            rig.advance(SETTLE, closure=closure)
            state = rig.measured("gripper.state_measured")
            force = rig.measured("gripper.wire_force")[0]
            return np.array([closure, *state, force])

        rows = [settle(closure) for closure in np.linspace(0.0, 1.0, STEPS + 1)]
        before = [row for row in rows if row[1 + _TIP] < _COUNT][-1][0]
        settle(before)  # an extra period, because the way back is long
        for k in range(1, FINE_STEPS):
            rows.append(settle(before + k / (FINE_STEPS * STEPS)))
    _, *state, force = np.array(sorted(rows, key=lambda row: float(row[0]))).T
    left, right = (np.array(state)[list(finger)] for finger in FINGERS)
    base, tip = left
    # The phases: the base arrives at its stop, then the tip starts.
    arrived = int(np.argmax(base > limits[0] - _COUNT))
    started = int(np.argmax(tip > _COUNT))
    return {
        "wire force [N]": force,
        "base [rad]": base,
        "tip [rad]": tip,
        "speed": np.max(np.abs(state[4:])),
        "asymmetry": np.max(np.abs(left - right)),
        "tip angle until the base stops [rad]": max(tip[: arrived + 1]),
        "base off its stop after that [rad]": max(abs(base[started:] - limits[0])),
        "wire force just before the base stops [N]": force[arrived - 1],
        "wire force when the tip starts [N]": force[started],
    }


def free_the_fingers(rig: Rig, stops: tuple[float, float]) -> None:
    """Set the joints' stops and remove gravity and contact."""
    for side in ("left", "right"):
        for link, stop in zip(("base", "tip"), stops, strict=True):
            joint = rig.plant.GetJointByName(f"{side}_{link}_joint")
            joint.set_position_limits([0.0], [stop])
    rig.plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    scene_graph = rig.station.GetSubsystemByName("scene_graph")
    everything = GeometrySet(scene_graph.model_inspector().GetAllGeometryIds())
    context = scene_graph.GetMyMutableContextFromRoot(rig.context)
    scene_graph.collision_filter_manager(context).Apply(
        CollisionFilterDeclaration().ExcludeWithin(everything)
    )


def against_vendor(trials: ex.Trials) -> dict[str, ex.Values]:
    """Compare angles at equal force, and forces at equal angle, over the whole table.

    Deviations of an angle are relative to the vendor's angle, but at least to `SMALL`.
    Forces are compared where the joint is between its stops.
    """
    ours = trials.where(stops=VENDOR)[0]
    force, _ = vendors()
    reached = ours["wire force [N]"][-1]
    arms = [line.split(",") for line in read_csv("tendon_moment_arms.csv")[1:]]
    found: dict[str, ex.Values] = {
        "all": {
            "wire force reached [N]": (reached, ex.at_least(force[-1])),
            "largest joint speed at readings [rad/s]": ours["speed"],
            "largest left-right difference [rad]": ours["asymmetry"],
        }
    }
    for joint, arm_of in (("base", base_moment_arm), ("tip", tip_moment_arm)):
        of_joint = [(float(x), float(y)) for name, x, y in arms if name == joint]
        angle, arm = np.array(of_joint).T
        found[joint] = {
            "moment arm, largest deviation [%]": 100
            * max(abs(arm_of(angle) / arm - 1)),
            **deviations(joint, ours["wire force [N]"], ours[f"{joint} [rad]"]),
        }
    return found


def vendors() -> tuple[Vector, dict[str, Vector]]:
    """Return the vendor's wire forces (K) [N] and the angles (K) of base and tip."""
    lines = read_csv("tendon_free_closing.csv")[1:]
    table = np.array([[float(x) for x in line.split(",")] for line in lines]).T
    return table[0], dict(zip(("base", "tip"), table[1:], strict=True))


def deviations(joint: str, wire_force: Vector, q: Vector) -> ex.Values:
    """Return how a joint's angles q (N) [rad] at wire forces (N) [N] deviate."""
    force, angles = vendors()
    expected = angles[joint]
    off = np.abs(np.interp(force, wire_force, q) - expected)
    moving = (expected > 0.0) & (expected < expected[-1])
    at_angle = np.interp(expected[moving], q, wire_force)
    same, share = max(off), 100 * max(off / np.maximum(expected, SMALL))
    below = 100 * max(off[moving] / expected[moving])
    return {
        "angle at equal force [%]": (share, THREE_PERCENT),
        "force at equal angle [%]": 100 * max(abs(at_angle / force[moving] - 1.0)),
        "angle at equal force [degrees]": (np.rad2deg(same), ex.number()),
        "angle at equal force, also below 3 degrees [%]": below,
    }


free_closing = ex.Experiment(
    "Joint angles of a finger that closes on nothing against the force of its wire.",
    lambda: ex.grid(stops=STOPS),
    trial,
    {
        "largest joint speed at readings": ex.at_most(1e-3),
        "largest left-right difference": ex.at_most(1e-6),
        "moment arm, largest deviation": THREE_PERCENT,
        "force at equal angle": THREE_PERCENT,
        "tip angle until the base stops": ex.at_most(_COUNT),
        "base off its stop after that": ex.at_most(_COUNT),
        "wire force when the tip starts": lambda own: ex.at_least(
            own.one("wire force just before the base stops [N]")
        ),
    },
    whole=against_vendor,
    picture=[ex.Curves("wire force [N]", ("base [rad]", "tip [rad]"))],
)
