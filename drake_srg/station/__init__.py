"""The station: plant, sensors and drivers, as the hardware would offer them."""

from drake_srg.station.station import AddStation, MakeStation

__all__ = ["AddStation", "MakeStation"]
