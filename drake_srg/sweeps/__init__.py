"""Many trials of a scenario: run them, report on them, make data sets of them."""
