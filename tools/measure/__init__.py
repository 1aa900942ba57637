"""Experiments for maintainers: the cost of what surrounds a simulation.

`drake-srg experiment NAME` runs them from a checkout; the wheel leaves them out.
"""
