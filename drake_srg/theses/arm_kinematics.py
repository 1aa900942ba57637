"""Forward kinematics by the product of exponentials, to check the plant's kinematics.

The equations are those of Lynch and Park, Modern Robotics (2017). A screw axis in the
space frame is (w, v): its direction w [unit vector] and v = -w x q [m] for any point q
on the axis. A prismatic joint has w = 0 and v as its direction. Angles are in rad,
lengths in m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# The five-axis arm, from its thesis ("Design and application of vision-based assistive
# robotic arm ..."), in the frame of its base: joint 1's axis is z, and the mounting
# plane is z = 0. Joint 4 as printed passes through (y, z) = (0.18974, 0.03813).
ASSISTIVE_ARM_SCREWS_PRINTED: Array = np.array(
    [
        [0, 0, 1, 0, 0, 0],
        [0, -1, 0, 0, 0, -0.06981],
        [0, -1, 0, 0.18974, 0, -0.11993],
        [-1, 0, 0, 0, -0.03813, 0.18974],
        [0, -1, 0, 0.18974, 0, 0.11617],
    ]
)
# With y and z swapped, joint 4 lies at the height of joints 3 and 5.
ASSISTIVE_ARM_SCREWS: Array = ASSISTIVE_ARM_SCREWS_PRINTED.copy()
ASSISTIVE_ARM_SCREWS[3, 3:] = [0, -0.18974, 0.03813]

# The tip's pose at zero angles, as appendix A prints it. Its matrix is a rotation up to
# rounding, and its y is that of the arm's plane in the thesis's world. Section 4.4.3
# prints the identity as the rotation, which does not give the angles of the thesis's
# example.
ASSISTIVE_ARM_HOME_PRINTED: Array = np.array(
    [
        [1.0, 0.0, 0.0018, -0.25308],
        [0.0, 1.0, 0.0, -0.17282],
        [-0.0018, 0.0, 1.0, 0.19001],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
ASSISTIVE_ARM_HOME_SECTION_4_4_3: Array = ASSISTIVE_ARM_HOME_PRINTED.copy()
ASSISTIVE_ARM_HOME_SECTION_4_4_3[:3, :3] = np.eye(3)
# The same pose with a proper rotation about y, in the arm's plane: the model's `tip`.
ASSISTIVE_ARM_HOME: Array = np.array(
    [
        [np.cos(0.0018), 0.0, np.sin(0.0018), -0.25308],
        [0.0, 1.0, 0.0, 0.0],
        [-np.sin(0.0018), 0.0, np.cos(0.0018), 0.19001],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def screw_exponential(screw: ArrayLike, theta: float) -> Array:
    """Return the motion by `theta` along a screw axis (equation 3.88).

    Args:
        screw: The axis (6), (w, v).
        theta: Joint position [rad], or [m] if w = 0.

    Returns:
        A homogeneous transform (4, 4).

    Raises:
        ValueError: If w, or v if w = 0, is not a unit vector.
    """
    w, v = np.split(np.asarray(screw, dtype=float), 2)
    if not np.isclose(np.linalg.norm(w if np.any(w) else v), 1.0):
        raise ValueError(f"screw: {[*w, *v]} must have a direction of unit length")
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    sin, versine = np.sin(theta), 2 * np.sin(theta / 2) ** 2  # versine = 1 - cos
    T = np.eye(4)
    T[:3, :3] += sin * W + versine * W @ W
    T[:3, 3] = theta * v + versine * W @ v + (theta - sin) * W @ W @ v
    return T


def forward_kinematics(screws: ArrayLike, home: ArrayLike, q: ArrayLike) -> Array:
    """Return the pose of an arm's tip by the product of exponentials (equation 4.14).

    Args:
        screws: The joints' axes at zero angles (N, 6) in the space frame, base first.
        home: The tip's pose at zero angles (4, 4) in the space frame.
        q: Joint positions (N) [rad].

    Returns:
        The tip's pose (4, 4) in the space frame.

    Raises:
        ValueError: If there are not as many positions as axes.
    """
    T = np.eye(4)
    for screw, theta in zip(np.asarray(screws), np.asarray(q), strict=True):
        T = T @ screw_exponential(screw, theta)
    return T @ np.asarray(home)


def euler_rotation(angles: ArrayLike) -> Array:
    """Return the rotation R (3, 3) = Rx(x) Ry(y) Rz(z) of the thesis's second script.

    Args:
        angles: x, y, z (3) [rad]; the thesis calls them alpha, beta, gamma.
    """
    (sx, sy, sz), (cx, cy, cz) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [cy * cz, -cy * sz, sy],
            [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
            [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
        ]
    )


def euler_angles(R: ArrayLike) -> Array:
    """Return the angles x, y, z (3) [rad] with R = Rx(x) Ry(y) Rz(z).

    y is within a quarter turn of zero. At exactly a quarter turn (gimbal lock), only
    the sum or the difference of x and z is determined: then x is 0.

    Args:
        R: A rotation matrix (3, 3).
    """
    R = np.asarray(R)
    y = np.arcsin(np.clip(R[0, 2], -1, 1))
    # Below this cosine of y, rounding errors in x and z exceed the error of treating y
    # as a quarter turn.
    if np.hypot(R[0, 0], R[0, 1]) < 1e-8:
        return np.array([0.0, y, np.arctan2(R[1, 0], R[1, 1])])
    x = np.arctan2(-R[1, 2], R[2, 2])
    z = np.arctan2(-R[0, 1], R[0, 0])
    return np.array([x, y, z])
