from drake_srg.export.files import FORMATS as FORMATS
from drake_srg.export.files import ExportedModel as ExportedModel
from drake_srg.export.files import export_scenario as export_scenario
