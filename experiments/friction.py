"""Friction of gears and wires, on and off: back-driving, hysteresis and creep.

The tips press on each other while the motor's torque rises to 60 % and falls again.
Then the motor loses its power. After that, the hand lifts a can and holds it for 5 s
with 107 N at each wire.

The gears' friction is what `drake-srg identify` finds in the vendor's log. The wires'
friction was never measured. They get the capstan friction of a polyethylene line on
metal (coefficient 0.1) around pulleys at base and tip hinge, 1.5 rad in all.
"""

import dataclasses as dc

import numpy as np

import experiments.runner as ex
from drake_srg.gripper.tendon import DriveFrictionConfig
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from experiments.hold_drift import BENCH, creep

WIRE = 0.15
# Torque of the motor, share of that at full PWM: up and down again in equal steps.
LADDER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
UP, DOWN = 2, 8  # steps of 30 %
HOLD_FORCE = 107.0  # of each wire, around the held can [N]
WITH = ("gears", "wires", "gears and wires")
GAP = "force, opening less closing, at 30 %"


def trial(friction: str) -> ex.Measures:
    gears = load_scenario("srg_specimen").gripper.wire_motor.drive.friction
    config = gears if "gears" in friction else DriveFrictionConfig()
    config = dc.replace(config, wire=WIRE if "wires" in friction else 0.0)
    entries = ", ".join(f"{k}: {v!r}" for k, v in dc.asdict(config).items())
    change = f"gripper.drive.friction={{{entries}}}"
    bench = bench_scenario(
        gripper_rpy=[0.0, 0.0, 0.0], overrides=["object.present=false", change]
    )
    wire, pad = [], []
    with Rig(bench, name="friction") as rig:
        rig.fix("gripper.force_limit", 1.0)
        rig.advance(1.5, closure=0.6)  # to near each other
        for torque in LADDER:
            rig.fix("gripper.motor_torque_commanded", torque)
            rig.advance(0.8)  # s, settles
            wire.append(np.mean(rig.measured("gripper.wire_force")))
            pad.append(0.5 * np.sum(rig.measured("gripper.contact_force")))
        closed = rig.measured("gripper.state_measured")[0]
        rig.fix("gripper.motor_torque_commanded", 0.0)
        rig.advance(3.0)
        left = np.mean(rig.measured("gripper.wire_force"))
        opened = closed - rig.measured("gripper.state_measured")[0]
    limit = bench.gripper.wire_motor.drive.force_limit_of(HOLD_FORCE)
    largest = {} if friction == "none" else {"largest pad force [N]": max(pad)}
    return largest | {
        "torque, share of full": LADDER,
        "force of each wire [N]": wire,
        "force of each finger [N]": pad,
        f"wire {GAP} [N]": wire[DOWN] - wire[UP],
        f"pad {GAP} [N]": pad[DOWN] - pad[UP],
        "pad force while closing [N]": pad[UP],
        "wire force after power is lost [N]": left,
        "base opens by [degrees]": np.rad2deg(opened),
        "creep of a held can [um/s]": creep("can", BENCH, [change], limit, 5.0),
    }


def no_more(own: ex.Trials) -> ex.Bound:
    """Expect that friction does not raise the force of the pads by more than 1 %."""
    without = own.whole.where(friction="none").one("force of each finger [N]")
    return ex.at_most(1.01 * max(without))


NONE = {"none": ex.within(0.0, absolute=1.0)}
friction = ex.Experiment(
    "Friction of gears and wires, on and off: back-driving, hysteresis and creep.",
    lambda: ex.grid(friction=("none", *WITH)),
    trial,
    {
        f"wire {GAP}": NONE,
        f"pad {GAP}": NONE | dict.fromkeys(WITH, ex.at_least(0.1)),
        "largest pad force": no_more,
    },
    picture=[
        ex.Curves("torque, share of full", "force of each wire [N]"),
        ex.Curves("torque, share of full", "force of each finger [N]"),
    ],
)
