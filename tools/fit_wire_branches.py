"""Fit the branches in drake_srg/export/mjcf.py to the moment arms of the wire."""

import numpy as np
from scipy.optimize import least_squares

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.tendon import base_moment_arm, tip_moment_arm
from drake_srg.types import Vector

# Points stay within reach of the links that carry them [mm].
LEAST, GREATEST = 1.0, 40.0
STARTS = 40


def branch_arm(branch: Vector, angle: Vector) -> Vector:
    """Return the moment arm of a branch (distances, angle) at joint angles."""
    a, b, c = branch
    length = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(c - angle))
    return np.asarray(a * b * np.sin(c - angle) / length)


def main() -> None:
    """Print the branches of each joint [m, rad], and the largest relative error."""
    angle = np.linspace(0.0, SRG.joint_limit, 91)
    for name, arm, count in (("base", base_moment_arm, 1), ("tip", tip_moment_arm, 3)):
        wanted = 1e3 * arm(angle)

        def error(x: Vector, wanted: Vector = wanted) -> Vector:
            return np.asarray(
                sum(branch_arm(b, angle) for b in x.reshape(-1, 3)) / wanted - 1
            )

        low = np.tile([LEAST, LEAST, -np.pi], count)
        high = np.tile([GREATEST, GREATEST, np.pi], count)
        random = np.random.default_rng(0)
        fits = [
            least_squares(error, random.uniform(low, high), bounds=(low, high))
            for _ in range(STARTS)
        ]
        best = min(fits, key=lambda fit: float(np.abs(fit.fun).max()))
        print(name, f"within {np.abs(best.fun).max():.2%}")
        for a, b, c in best.x.reshape(-1, 3):
            print(f"    ({a / 1e3:.8f}, {b / 1e3:.8f}, {c:.6f}),")


if __name__ == "__main__":
    main()
