"""The eye of a visual servo: a tracker on the pictures of a camera, never waiting."""

from __future__ import annotations

import dataclasses as dc
import math

from drake_srg.hardware.cameras import Camera
from drake_srg.servoing.sightings import Sighting
from drake_srg.servoing.tracker import Tracker


class ServoEye:
    """Finds the object in the newest picture of a camera.

    Args:
        tracker: Reads the pictures.
        camera: Of the hand.
    """

    def __init__(self, tracker: Tracker, camera: Camera) -> None:
        self._tracker, self._camera = tracker, camera
        self._stamp = -math.inf  # of the picture before

    def look(self) -> Sighting | None:
        """Return what the newest picture shows; None if it has been looked at."""
        picture = self._camera.newest()
        if picture is None or picture.stamp <= self._stamp:
            return None
        self._stamp = picture.stamp
        seen = self._tracker.sight(picture.color, picture.depth)
        return dc.replace(seen, stamp=picture.stamp)
