"""Names of a run's logged signals that more than one module reads."""

_POSE = "object_pose."


def pose_key(name: str) -> str:
    """Return the key of an object's poses in a log."""
    return f"{_POSE}{name}"


def is_pose(key: str) -> bool:
    """Return whether a key of a log is that of an object's poses."""
    return key.startswith(_POSE)
