"""Reruns experiments and compares their figures with the committed ones.

`make experiments` runs it. docs/experiments holds the committed figures: NAME.json is
the result.json of an experiment and NAME.png its picture; stamps.json says what each
was made with. The tables of docs/experiments.md are made from these files alone.
"""
