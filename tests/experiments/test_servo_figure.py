import numpy as np
import pytest

from drake_srg.experiments.servo_bench import Response
from drake_srg.experiments.servo_figure import draw
from drake_srg.experiments.servo_laws import LAWS
from drake_srg.experiments.servo_motions import MOTIONS


@pytest.mark.parametrize("laws", [tuple(LAWS), ("pid", "literal")])
def test_every_law_is_drawn(laws):
    response = Response(*np.zeros((5, 3)))
    figure = draw({motion: dict.fromkeys(laws, response) for motion in MOTIONS})
    (legend,) = figure.legends
    texts = {text.get_text() for text in legend.get_texts()}
    assert texts == {"reference", *laws}
