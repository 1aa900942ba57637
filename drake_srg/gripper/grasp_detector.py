"""Detects whether something is between the fingers."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class GraspDetectorConfig:
    """When a grasp counts."""

    # All fingers must fire for this long [s]: the arm thesis's post-contact delay.
    post_contact_delay: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Time between evaluations [s].
    period: float = dc.field(default=0.01, metadata=positive())


class GraspDetector(LeafSystem):
    """Reports a grasp once every finger has sensed something for a while.

    .. pydrake_system::

        name: GraspDetector
        input_ports:
        - triggered
        output_ports:
        - grasped

    `triggered` (m) is nonzero where a sensor fires. `grasped` (1) is 1 while at least
    one sensor of each finger has fired without a break for `config.post_contact_delay`,
    else 0. The fingers of a closed empty hand sense each other: to tell that from a
    grasp, look at the joint angles, too.

    Args:
        fingers: The indices of each finger's sensors.
        config: When a grasp counts.
    """

    def __init__(
        self,
        fingers: Sequence[Sequence[int]],
        config: GraspDetectorConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or GraspDetectorConfig()
        self._fingers = [list(finger) for finger in fingers]
        self._triggered = self.DeclareVectorInputPort(
            name="triggered", size=sum(len(finger) for finger in fingers)
        )
        # Time since when all fingers have sensed something; inf while they do not.
        self.DeclareDiscreteState([np.inf])
        self.DeclareVectorOutputPort(
            name="grasped",
            size=1,
            calc=self._calc_grasped,
            prerequisites_of_calc={self.time_ticket(), self.xd_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        fired = self._triggered.Eval(context).tolist()
        since = np.inf
        if all(any(fired[i] for i in finger) for finger in self._fingers):
            since = min(context.get_discrete_state(0).value()[0], context.get_time())
        discrete_state.set_value([since])

    def _calc_grasped(self, context: Context, output: BasicVector) -> None:
        since = context.get_discrete_state(0).value()[0]
        output[0] = context.get_time() - since >= self.config.post_contact_delay
