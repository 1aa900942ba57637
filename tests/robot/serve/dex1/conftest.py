"""Tests of the hand's topics need cyclonedds; those without DDS run anywhere."""

import pytest

from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import WiredGripper


@pytest.fixture
def inbox(told):
    return CommandInbox([], Warnings(told.append))


@pytest.fixture
def gripper():
    return WiredGripper(SrgTendonDriver())
