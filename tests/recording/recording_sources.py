"""Sources to record from, and a check for leaks."""

from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.lifetime import LeafSystem

RED, BLUE = (220, 30, 30, 255), (30, 30, 220, 255)


def image(color, width=64, height=48):
    made = ImageRgba8U(width, height)
    made.mutable_data[:] = color
    return made


class Sweep(LeafSystem):
    """An image that is red left of a line, which moves to the right at 10 pixels/s."""

    def __init__(self, width=64, height=48):
        super().__init__()
        self.evaluations = 0

        self._size = (width, height)
        self.DeclareAbstractOutputPort(
            "color_image", lambda: AbstractValue.Make(ImageRgba8U()), self._calc
        )

    def _calc(self, context, output):
        self.evaluations += 1
        made = image(BLUE, *self._size)
        made.mutable_data[:, : int(10 * context.get_time() + 0.5)] = RED
        output.set_value(made)
