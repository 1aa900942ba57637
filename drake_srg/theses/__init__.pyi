from drake_srg.theses.blob_localizer import ThesisBlobConfig as ThesisBlobConfig
from drake_srg.theses.blob_localizer import ThesisBlobLocalizer as ThesisBlobLocalizer
from drake_srg.theses.script import Script as Script
from drake_srg.theses.script import ScriptedPlanner as ScriptedPlanner
from drake_srg.theses.script import ScriptStep as ScriptStep
from drake_srg.theses.taught import Taught as Taught
from drake_srg.theses.taught import TaughtPlanner as TaughtPlanner
