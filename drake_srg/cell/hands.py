"""The planner's model of each gripper.

Gripper drivers know nothing of planning, so the `Hand` of each is made here, from the
driver's configuration. `register_gripper` is the one place where a gripper driver of
your own becomes known: to scenario files by its tag, and to the planner.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import (
    GripperDriver,
    LinkageDriver,
    PlantServoDriver,
    SrgPositionDriver,
    SrgTendonDriver,
)
from drake_srg.planning.grasps.grasps import Hand
from drake_srg.planning.grasps.linkage_hand import LinkageFingers, LinkageHand
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.scenario.schema import Scenario, accept_driver
from drake_srg.types import Vector

# Makes a Hand from a driver's configuration, the planner's, and a finalized plant of
# the scenario's models with the model instance `gripper`. The plant may not live on.
HandMaker = Callable[[Any, PlannerConfig, MultibodyPlant], Hand]


def register_gripper(
    driver: type[GripperDriver], make_hand: HandMaker | None = None
) -> None:
    """Make a gripper driver known to scenario files and to the planner.

    Args:
        driver: Class of its configuration; the class name is its tag.
        make_hand: Makes what the planner knows of the gripper. None: as for the class
            that `driver` derives from, if there is a Hand for that.
    """
    accept_driver(driver)
    if make_hand is not None:
        _HANDS[driver] = make_hand


def MakeHand(scenario: Scenario, plant: MultibodyPlant) -> Hand:
    """Make what the planner knows of a scenario's gripper.

    Args:
        scenario: With a gripper.
        plant: A finalized plant of the scenario's models. The Hand does not keep it.

    Raises:
        ScenarioError: If there is no Hand for the gripper's driver.
    """
    for kind in type(scenario.gripper).__mro__:
        if kind in _HANDS:
            return _HANDS[kind](scenario.gripper, scenario.planner, plant)
    known = ", ".join(f"!{driver.__name__}" for driver in _HANDS)
    raise ScenarioError(
        f"gripper: the planner needs a Hand for !{type(scenario.gripper).__name__}: "
        f"give one to register_gripper (allowed: {known})"
    )


def _srg_position_hand(
    driver: SrgPositionDriver | PlantServoDriver,
    config: PlannerConfig,
    _: MultibodyPlant,
) -> SrgHand:
    return _srg_hand(config, driver.underactuation.full_scale)


def _srg_tendon_hand(
    driver: SrgTendonDriver, config: PlannerConfig, _: MultibodyPlant
) -> SrgHand:
    return _srg_hand(config, driver.spool.full_scale)


def _srg_hand(config: PlannerConfig, full_scale: float) -> SrgHand:
    return SrgHand(
        config.approaches,
        config.tilts,
        config.squeeze,
        full_scale,
        clearance=config.hand_clearance,
    )


def _linkage_hand(
    driver: LinkageDriver, _: PlannerConfig, plant: MultibodyPlant
) -> LinkageHand:
    gripper = plant.GetModelInstanceByName("gripper")

    def p_GF(name: str) -> Vector:
        frame = plant.GetFrameByName(name, gripper)
        X_GF = frame.GetFixedPoseInBodyFrame()
        return np.array(X_GF.translation())  # a copy: the plant may not live on

    def calibrated(name: str, otherwise: Vector) -> Vector:
        return p_GF(name) if plant.HasFrameNamed(name, gripper) else otherwise

    p_GT = calibrated("tip", p_GF("grasp_center"))
    return LinkageHand(
        p_GT,
        calibrated("released", p_GT) - p_GT,
        LinkageFingers(full_scale=driver.master_slave.full_scale),
    )


_HANDS: dict[type[GripperDriver], HandMaker] = {
    SrgPositionDriver: _srg_position_hand,
    PlantServoDriver: _srg_position_hand,
    SrgTendonDriver: _srg_tendon_hand,
    LinkageDriver: _linkage_hand,
}
