"""Simulation: runs a cell, logs and records the run, and judges the result."""

from drake_srg.simulation.simulate import Result, Simulate, failure_time

__all__ = ["Result", "Simulate", "failure_time"]
