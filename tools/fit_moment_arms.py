"""Fit the polynomials in drake_srg/gripper/tendon.py to the vendor's data."""

from pathlib import Path

import numpy as np

DATA = Path(__file__).parents[1] / "experiments/data/tendon_moment_arms.csv"
# The lowest degrees with errors below 0.1 %. The fit must be that close because the
# closing angle is steep in the force: near 0.6 N, 1 % of the arm is 6 % of the angle.
DEGREES = {"base": 7, "tip": 4}


def main() -> None:
    """Print the coefficients, lowest power first, and the largest relative error."""
    rows = [
        line.split(",")
        for line in DATA.read_text().splitlines()
        if line.startswith(("base", "tip"))
    ]
    for joint, degree in DEGREES.items():
        angle, arm = np.array([r[1:] for r in rows if r[0] == joint], float).T
        fit = np.polynomial.Polynomial.fit(angle, arm, degree).convert()
        coefficients = [float(f"{c:.6e}") for c in fit.coef]
        error = np.abs(np.polynomial.polynomial.polyval(angle, coefficients) / arm - 1)
        print(joint, coefficients, f"within {error.max():.3%}")


if __name__ == "__main__":
    main()
