"""Wait for other threads and processes, with a timeout as a guard."""

import time


def wait_until(condition, timeout=20.0):
    """Wait until `condition()` is true; return its last value."""
    end = time.monotonic() + timeout
    while not (value := condition()) and time.monotonic() < end:
        time.sleep(0.01)
    return value
