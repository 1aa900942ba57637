"""Runs, judges, draws and compares experiments: what a file of claims imports."""

from experiments.runner.claims import Bound as Bound
from experiments.runner.claims import Case as Case
from experiments.runner.claims import Measures as Measures
from experiments.runner.claims import Row as Row
from experiments.runner.claims import Trials as Trials
from experiments.runner.claims import Values as Values
from experiments.runner.claims import at_least as at_least
from experiments.runner.claims import at_most as at_most
from experiments.runner.claims import counts as counts
from experiments.runner.claims import number as number
from experiments.runner.claims import quantiles as quantiles
from experiments.runner.claims import share as share
from experiments.runner.claims import wilson as wilson
from experiments.runner.claims import within as within
from experiments.runner.experiment import Experiment as Experiment
from experiments.runner.experiment import chosen as chosen
from experiments.runner.experiment import grid as grid
from experiments.runner.pictures import Bars as Bars
from experiments.runner.pictures import Curves as Curves
from experiments.runner.pictures import Histogram as Histogram
from experiments.runner.pictures import Images as Images
from experiments.runner.pictures import Points as Points
