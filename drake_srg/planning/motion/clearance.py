"""Clearance between bodies."""

import dataclasses as dc


@dc.dataclass(frozen=True)
class Clearance:
    """The pair of bodies that comes closest to breaking its margin."""

    distance: float  # signed distance [m]; inf where nothing is near
    margin: float  # the distance that this pair must keep [m]
    bodies: tuple[str, str]

    @property
    def spare(self) -> float:
        """Distance beyond the margin [m]; negative where the margin is broken."""
        return self.distance - self.margin

    def __str__(self) -> str:
        first, second = self.bodies
        return (
            f"{first} and {second} are {1e3 * self.distance:.1f} mm apart, "
            f"must be {1e3 * self.margin:.1f} mm"
        )
