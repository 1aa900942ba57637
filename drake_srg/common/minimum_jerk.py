"""The blend of a rest-to-rest motion with minimum jerk."""


def minimum_jerk_blend(s: float) -> float:
    """Return how far a rest-to-rest motion of least jerk is, 0 .. 1.

    T. Flash, N. Hogan, J. Neurosci. 5(7), 1985.

    Args:
        s: Time since its start over its duration; before 0 and after 1 it rests.
    """
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))
