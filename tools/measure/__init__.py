"""Experiments for maintainers: the cost of sweeps and the localizer's thresholds.

`drake-srg experiment NAME` runs them from a checkout; the wheel leaves them out.
"""
