"""Robots in place of the simulation: drivers, the station, and runs on hardware."""

from drake_srg.hardware.config import HardwareConfig, load_hardware
from drake_srg.hardware.link import HardwareDriver, Link
from drake_srg.hardware.opening import Hardware, open_hardware
from drake_srg.hardware.run import run_on_hardware
from drake_srg.hardware.station import MakeHardwareStation

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
