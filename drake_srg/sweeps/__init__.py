"""Runs many trials of a scenario, reports on them and makes data sets of them."""
