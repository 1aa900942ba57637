"""The station with the interface of the hardware, and the cell around it.

A station is a plant with its sensors and drivers. A cell is a station with a localizer
and a planner, and works autonomously.
"""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
