"""The blend of a rest-to-rest motion with minimum jerk."""


def minimum_jerk_blend(s: float) -> float:
    """Return the progress of a rest-to-rest motion with minimum jerk, 0 .. 1.

    T. Flash, N. Hogan, J. Neurosci. 5(7), 1985.

    Args:
        s: Time since the start as a share of the duration. The motion rests before 0
            and after 1.
    """
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))
