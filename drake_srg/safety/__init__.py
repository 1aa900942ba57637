"""Limits of the arm's motion that hold whatever commands it, and stops along the path.

See `drake_srg.safety.monitor.SafetyMonitor`.
"""
