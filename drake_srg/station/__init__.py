"""The station: plant, sensors and drivers, with the interface of the hardware."""

from drake_srg.station.station import AddStation, MakeStation

__all__ = ["AddStation", "MakeStation"]
