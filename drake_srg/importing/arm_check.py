"""Check that an imported arm holds still, follows commands and keeps its limits."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg import parsing
from drake_srg.arm.driver import ArmPositionDriver
from drake_srg.common.systems import model_actuators
from drake_srg.objects.household import Image
from drake_srg.scenario.schema import Scenario
from drake_srg.simulation.rig import Rig
from drake_srg.types import Vector

# Largest allowed motion of a joint at home in 1 s, and largest allowed distance from
# the command during a move [rad or m].
STILL, FOLLOWS = 0.002, 0.02
# Length of the move of each joint [rad or m], and the share of its limits that it uses.
_STEP, _SHARE = 0.3, 0.5
# Peaks of a minimum-jerk move of unit length in unit time.
_PEAK_SPEED, _PEAK_ACCELERATION = 1.875, 5.7735
# In the test of its limits, each joint starts this far inside a limit (`_INSIDE`), is
# commanded this far beyond it (`_BEYOND`) and may overrun it by `OVERRUN` [rad or m].
_BEYOND, _INSIDE, OVERRUN = 0.3, 0.1, 0.02
_TIME_STEP, _TIME = 0.001, 0.5  # s


@dc.dataclass(frozen=True)
class ArmCheck:
    """Outcome of an arm's checks in simulation.

    Attributes:
        moved: Largest motion of a joint that is commanded to stay at home for 1 s [rad
            or m].
        behind: Largest distance of a joint from its command, on a minimum-jerk move at
            half of the limits [rad or m].
        overrun: Largest distance of a joint beyond a limit that it is commanded to
            cross [rad or m].
        strained: Largest torque in this test, as a share of the torque limit.
        gravity: Largest torque at home, as a share of the torque limit.
    """

    moved: float
    behind: float
    overrun: float
    strained: float
    gravity: float

    def problems(self) -> list[str]:
        """Return the problems, in words."""
        return [
            text
            for wrong, text in (
                (
                    self.gravity > 1.0,
                    f"holding it at home takes {self.gravity:.2f} of a torque limit",
                ),
                (
                    self.moved > STILL,
                    f"does not hold still: {self.moved:.4f} rad or m (at most {STILL})",
                ),
                (
                    self.behind > FOLLOWS,
                    f"does not follow: {self.behind:.4f} rad or m off "
                    f"(at most {FOLLOWS})",
                ),
                (
                    self.overrun > OVERRUN,
                    f"overruns its limits by {self.overrun:.4f} rad or m "
                    f"(at most {OVERRUN})",
                ),
                (
                    self.strained > 1.0 + 1e-6,
                    f"exerts {self.strained:.2f} of its torque limits",
                ),
            )
            if wrong
        ]


def check_arm(scenario: Scenario, model: Path) -> tuple[ArmCheck, Image]:
    """Check an arm, and return a picture of it at home.

    Args:
        scenario: Scenario with the arm, its home and a video camera.
        model: The arm's file.
    """
    assert scenario.arm is not None
    home = np.array(scenario.arm.home)
    with Rig(scenario, name=model.parent.name, images=True) as rig:
        picture = rig.image(scenario.recording.video_camera)
        rig.advance(1.0)
        start = len(rig.log()["time"])
        states = rig.log()["arm.state_cheat"][:, : len(home)]
        moved = float(np.abs(states - home).max())
        arm = rig.plant.GetModelInstanceByName("arm")
        efforts = np.array([a.effort_limit() for a in model_actuators(rig.plant, arm)])
        gravity = np.abs(rig.measured("arm.torque_measured")) / efforts
        goal, duration = _move(rig.plant, home)
        rig.move(goal, duration)
        log = rig.log()
        rows = slice(start, None)
        behind = (
            log["arm.position_commanded"][rows]
            - log["arm.state_cheat"][rows, : len(home)]
        )
    overrun, strained = 0.0, 0.0
    for side in (1.0, -1.0):
        beyond, share = _run_into_limits(model, home, side)
        overrun, strained = max(overrun, beyond), max(strained, share)
    check = ArmCheck(
        moved, float(np.abs(behind).max()), overrun, strained, float(gravity.max())
    )
    return check, picture


def _move(plant: MultibodyPlant, home: Vector) -> tuple[Vector, float]:
    """Return the goal of a move from home, away from limits, and its duration [s]."""
    arm = plant.GetModelInstanceByName("arm")
    lower = plant.GetPositionsFromArray(arm, plant.GetPositionLowerLimits())
    upper = plant.GetPositionsFromArray(arm, plant.GetPositionUpperLimits())
    inwards = np.where(home - lower > upper - home, -1.0, 1.0)
    velocity = _SHARE * plant.GetVelocitiesFromArray(
        arm, plant.GetVelocityUpperLimits()
    )
    acceleration = _SHARE * plant.GetVelocitiesFromArray(
        arm, plant.GetAccelerationUpperLimits()
    )
    times = [
        *(_PEAK_SPEED * _STEP / velocity),
        *np.sqrt(_PEAK_ACCELERATION * _STEP / acceleration),
    ]
    return home + _STEP * inwards, float(max(times))


def _run_into_limits(model: Path, home: Vector, side: float) -> tuple[float, float]:
    """Command all joints across their upper (side 1) or lower (-1) limits.

    The arm has neither weight nor surroundings.

    Returns:
        Largest distance of a joint beyond its limit [rad or m], and largest torque as a
        share of the torque limit.
    """
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(time_step=_TIME_STEP))
    arm = parsing.AddModel(plant, model, "arm")
    base = plant.GetFrameByName("link_0", arm)
    plant.WeldFrames(plant.world_frame(), base)
    driver = ArmPositionDriver(home=[float(q) for q in home], weightless=True)
    driver.prepare_plant(plant, arm)
    plant.Finalize()
    driver.SetGains(plant, arm)
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    limit = upper if side > 0.0 else lower
    bounded = np.isfinite(limit)
    start = np.where(bounded, limit - side * _INSIDE, home)
    goal = np.where(bounded, limit + side * _BEYOND, home)
    source = builder.AddSystem(ConstantVectorSource(np.append(goal, 0.0 * goal)))
    builder.Connect(source.get_output_port(), plant.get_desired_state_input_port(arm))
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, start)
    efforts = np.array([a.effort_limit() for a in model_actuators(plant, arm)])
    overrun, strained = 0.0, 0.0
    for t in np.arange(0.01, _TIME, 0.01):
        simulator.AdvanceTo(t)
        q = plant.GetPositions(context)
        torque = plant.get_net_actuation_output_port(arm).Eval(context)
        overrun = max(overrun, float((side * (q - limit))[bounded].max(initial=0.0)))
        strained = max(strained, float((np.abs(torque) / efforts).max()))
    return overrun, strained
