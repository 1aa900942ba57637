"""Forward kinematics by the product of exponentials, beside the plant's own.

Equations are those of Lynch and Park, Modern Robotics (2017). A screw axis in the space
frame is (w, v): direction w [unit vector] and v = -w x q [m] for any point q on it; a
prismatic joint has w = 0 and v its direction. Angles are in rad, lengths in m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# The five-axis arm, from its thesis ("Design and application of vision-based assistive
# robotic arm ..."), in the frame of its base: joint 1's axis is z, the mounting plane
# z = 0. Joint 4 as printed passes through (y, z) = (0.18974, 0.03813).
ASSISTIVE_ARM_SCREWS_PRINTED: Array = np.array(
    [
        [0, 0, 1, 0, 0, 0],
        [0, -1, 0, 0, 0, -0.06981],
        [0, -1, 0, 0.18974, 0, -0.11993],
        [-1, 0, 0, 0, -0.03813, 0.18974],
        [0, -1, 0, 0.18974, 0, 0.11617],
    ]
)
# With its y and z the right way round, joint 4 lies at the height of joints 3 and 5.
ASSISTIVE_ARM_SCREWS: Array = ASSISTIVE_ARM_SCREWS_PRINTED.copy()
ASSISTIVE_ARM_SCREWS[3, 3:] = [0, -0.18974, 0.03813]

# The tip's pose at zero angles as printed: its matrix is a rotation but for rounding,
# and its y is the place of the arm's plane in the world of the thesis.
ASSISTIVE_ARM_HOME_PRINTED: Array = np.array(
    [
        [1.0, 0.0, 0.0018, -0.25308],
        [0.0, 1.0, 0.0, -0.17282],
        [-0.0018, 0.0, 1.0, 0.19001],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
# The same with a proper rotation, about y, and in the arm's plane: the model's `tip`.
ASSISTIVE_ARM_HOME: Array = np.array(
    [
        [np.cos(0.0018), 0.0, np.sin(0.0018), -0.25308],
        [0.0, 1.0, 0.0, 0.0],
        [-np.sin(0.0018), 0.0, np.cos(0.0018), 0.19001],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def ScrewExponential(screw: ArrayLike, theta: float) -> Array:
    """Return the motion by `theta` along a screw axis (equation 3.88).

    Args:
        screw: The axis (6), (w, v).
        theta: Joint position [rad], or [m] where w = 0.

    Returns:
        A homogeneous transform (4, 4).

    Raises:
        ValueError: If neither w nor, with w = 0, v is a unit vector.
    """
    w, v = np.split(np.asarray(screw, dtype=float), 2)
    if not np.isclose(np.linalg.norm(w if np.any(w) else v), 1.0):
        raise ValueError(f"screw: {[*w, *v]} has no direction of unit length")
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    sin, versine = np.sin(theta), 2 * np.sin(theta / 2) ** 2  # versine = 1 - cos
    T = np.eye(4)
    T[:3, :3] += sin * W + versine * W @ W
    T[:3, 3] = theta * v + versine * W @ v + (theta - sin) * W @ W @ v
    return T


def ForwardKinematics(screws: ArrayLike, home: ArrayLike, q: ArrayLike) -> Array:
    """Return the pose of an arm's tip by the product of exponentials (equation 4.14).

    Args:
        screws: The joints' axes at zero (N, 6) in the space frame, from the base out.
        home: The tip's pose at zero (4, 4) in the space frame.
        q: Joint positions (N) [rad].

    Returns:
        The tip's pose (4, 4) in the space frame.

    Raises:
        ValueError: If the number of positions is not the number of axes.
    """
    T = np.eye(4)
    for screw, theta in zip(np.asarray(screws), np.asarray(q), strict=True):
        T = T @ ScrewExponential(screw, theta)
    return T @ np.asarray(home)


def EulerAngles(R: ArrayLike) -> Array:
    """Return the angles x, y, z (3) [rad] with R = Rx(x) Ry(y) Rz(z).

    y is within a quarter turn of zero, where x and z are unique.

    Args:
        R: A rotation matrix (3, 3).
    """
    R = np.asarray(R)
    return np.array(
        [
            np.arctan2(-R[1, 2], R[2, 2]),
            np.arcsin(np.clip(R[0, 2], -1, 1)),
            np.arctan2(-R[0, 1], R[0, 0]),
        ]
    )
