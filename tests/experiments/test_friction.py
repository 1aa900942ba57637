import numpy as np

from drake_srg.experiments.friction import Loop, changes, frictions, judge
from drake_srg.scenario import load_scenario

TORQUE = np.array([0.1, 0.3, 0.6, 0.3, 0.1])
NONE = Loop(TORQUE, 300.0 * TORQUE, 30.0 * TORQUE, 0.0, 0.5)


def test_every_friction_is_one_that_the_bench_takes():
    for friction in frictions().values():
        overrides = [f"{k}={v}" for k, v in changes(friction).items()]
        bench = load_scenario("gripper_bench", overrides=overrides)
        assert bench.gripper.drive.friction == friction


def test_without_friction_a_grip_must_not_depend_on_its_past():
    assert all(row.passed for row in judge("none", NONE, NONE))
    wire = NONE.wire.copy()
    wire[3] += 2.0
    stuck = Loop(TORQUE, wire, NONE.pad, 0.0, 0.5)
    assert not all(row.passed for row in judge("none", stuck, NONE))


def test_friction_must_show_and_must_not_add_force():
    pad = NONE.pad + np.array([0.0, 0.0, 0.0, 5.0, 5.0])
    good = Loop(TORQUE, NONE.wire, pad, 50.0, 0.1)
    assert all(row.passed for row in judge("gears", good, NONE))
    assert not all(row.passed for row in judge("gears", NONE, NONE))
    strong = Loop(TORQUE, NONE.wire, 2.0 * pad, 50.0, 0.1)
    assert not all(row.passed for row in judge("gears", strong, NONE))
