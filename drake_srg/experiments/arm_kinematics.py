"""The five-axis arm's forward kinematics, checked as its thesis checks them.

The thesis predicts the tip's Euler angles at one posture by the product of exponentials
and compares them with those of its simulation.
"""

from __future__ import annotations

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

from drake_srg.experiments.row import Row
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.station.plant import AddDirectives
from drake_srg.theses.arm_kinematics import (
    ASSISTIVE_ARM_HOME,
    ASSISTIVE_ARM_HOME_PRINTED,
    ASSISTIVE_ARM_HOME_SECTION_4_4_3,
    ASSISTIVE_ARM_SCREWS,
    ASSISTIVE_ARM_SCREWS_PRINTED,
    euler_angles,
    forward_kinematics,
)
from drake_srg.types import Vector

SCENARIO = "assistive_arm"
# The thesis's example: joint angles, and the tip's Euler angles as it predicts them and
# as it reads them in CoppeliaSim [degrees].
POSTURE = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
PREDICTED = np.array([-136.3074, -68.1808, -108.777])
SIMULATED = np.array([-136.342, -68.221, -108.737])
_PRINTED_WITHIN = 1e-4  # of the print's last digit [degrees]
_SETTLED = 3.0  # time in which the arm comes to rest there [s]


def kinematics_rows() -> list[Row]:
    """Compare printed, predicted, modelled and simulated angles of the tip."""
    q = np.deg2rad(POSTURE)
    name = "forward kinematics"
    theirs = float(np.max(np.abs(SIMULATED - PREDICTED)))
    printed, section = (
        _predict(ASSISTIVE_ARM_SCREWS_PRINTED, home, q)
        for home in (ASSISTIVE_ARM_HOME_PRINTED, ASSISTIVE_ARM_HOME_SECTION_4_4_3)
    )
    model = _predict(ASSISTIVE_ARM_SCREWS, ASSISTIVE_ARM_HOME, q)
    return [
        Row.at_most(
            name,
            "appendix A's screws and M against the printed angles",
            _PRINTED_WITHIN,
            _largest(printed - PREDICTED),
            "degrees",
        ),
        Row.at_least(
            name,
            "the same with the M of section 4.4.3; expected: more than that",
            _PRINTED_WITHIN,
            _largest(section - PREDICTED),
            "degrees",
        ),
        Row.at_most(
            name,
            "simulated arm against prediction; expected: CoppeliaSim's",
            theirs,
            _largest(simulated_angles(q) - model),
            "degrees",
        ),
        Row.at_most(
            name,
            "plant against product of exponentials, 1,000 postures",
            theirs,
            kinematics_error(),
            "degrees",
        ),
    ]


def _predict(screws: Vector, home: Vector, q: Vector) -> Vector:
    """Return the tip's Euler angles by the product of exponentials (3) [degrees]."""
    return np.rad2deg(euler_angles(forward_kinematics(screws, home, q)[:3, :3]))


def simulated_angles(q: Vector) -> Vector:
    """Return the tip's Euler angles when the arm has come to rest (3) [degrees].

    The arm starts at `q` (5) [rad] and holds it against gravity with its servos.
    Nothing collides: in the thesis's posture, the hand would be in the bench.
    """
    changes = [
        f"arm.home={q.tolist()}",
        "object.present=false",
        'ignored_contacts=[["*", "*"]]',
    ]
    scenario = load_scenario(SCENARIO, seed=0, overrides=changes)
    station = MakeStation(scenario)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    station.GetInputPort("arm.position_commanded").FixValue(context, q)
    station.GetInputPort("gripper.closure_commanded").FixValue(context, [0.0])
    simulator.AdvanceTo(_SETTLED)
    plant = station.GetSubsystemByName("plant")
    X_BT = tip_pose(plant, plant.GetMyContextFromRoot(context))
    return np.rad2deg(euler_angles(X_BT[:3, :3]))


def tip_pose(plant: MultibodyPlant, context: object) -> Vector:
    """Return the pose of the arm's tip in its base, shape (4, 4)."""
    arm = plant.GetModelInstanceByName("arm")
    base, tip = (plant.GetFrameByName(name, arm) for name in ("base", "tip"))
    pose: Vector = plant.CalcRelativeTransform(context, base, tip).GetAsMatrix4()
    return pose


def kinematics_error() -> float:
    """Return the largest error of the plant's forward kinematics [degrees].

    The error is the difference of the tip's Euler angles from those of the product of
    exponentials, over 1,000 random postures within the joint limits.
    """
    plant = MultibodyPlant(time_step=0.0)
    AddDirectives(plant, load_scenario(SCENARIO))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName("arm")
    rows = plant.GetActuatedJointIndices(arm)
    joints = [plant.get_joint(index) for index in rows]
    lower, upper = (
        np.array([getattr(joint, f"position_{end}_limits")()[0] for joint in joints])
        for end in ("lower", "upper")
    )
    worst = 0.0
    for q in np.random.default_rng(0).uniform(lower, upper, (1000, len(joints))):
        plant.SetPositions(context, arm, q)
        angles = np.rad2deg(euler_angles(tip_pose(plant, context)[:3, :3]))
        predicted = _predict(ASSISTIVE_ARM_SCREWS, ASSISTIVE_ARM_HOME, q)
        worst = max(worst, _largest(angles - predicted))
    return worst


def _largest(difference: Vector) -> float:
    """Return the largest angle (n) [degrees], whole turns aside."""
    return float(np.max(np.abs((difference + 180.0) % 360.0 - 180.0)))
