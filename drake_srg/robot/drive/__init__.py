"""Robots in place of the simulation: drivers, the station, and runs on hardware."""

from drake_srg.robot.drive.config import HardwareConfig, load_hardware
from drake_srg.robot.drive.link import HardwareDriver, Link
from drake_srg.robot.drive.opening import Hardware, open_hardware
from drake_srg.robot.drive.run import run_on_hardware
from drake_srg.robot.drive.station import MakeHardwareStation

__all__ = [
    "Hardware",
    "HardwareConfig",
    "HardwareDriver",
    "Link",
    "MakeHardwareStation",
    "load_hardware",
    "open_hardware",
    "run_on_hardware",
]
