"""Writes a scenario's models as URDF, SDF or MJCF, for other simulators and tools."""

from drake_srg.export.files import FORMATS, ExportedModel, export_scenario

__all__ = ["FORMATS", "ExportedModel", "export_scenario"]
