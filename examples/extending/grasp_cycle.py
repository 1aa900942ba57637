"""A state machine of your own: it closes the gripper, holds, and opens again."""

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg import MakeStation, load_scenario
from drake_srg.planning import ModeActions, StateMachine, next_mode

# mode: [(condition on what is observed and the time in the mode [s]; next mode)]
TABLE = {
    "open": [(lambda grasped, t: t >= 1.0, "close")],
    "close": [
        (lambda grasped, t: grasped, "hold"),
        (lambda grasped, t: t >= 3.0, "open"),
    ],
    "hold": [(lambda grasped, t: t >= 2.0, "open")],
}


class Command(ModeActions):
    """Commands a closure as the mode begins; observes whether something is grasped."""

    def __init__(self, closure):
        self.closure = closure

    def enter(self, memory, entry):
        """Return the memory as the mode begins: the closure."""
        return self.closure

    def observe(self, memory, now):
        """Return what the transitions see: whether something is grasped."""
        return now.senses


class GraspCycle(StateMachine):
    """Closes, holds and opens; its memory is the closure that it commands."""

    def __init__(self):
        super().__init__(
            {"open": Command(0.0), "close": Command(0.66), "hold": Command(0.66)},
            initial="open",
            memory=0.0,
            transition=lambda mode, grasped, t: next_mode(TABLE, mode, grasped, t),
            period=0.01,
        )
        self._grasped = self.DeclareVectorInputPort("grasped", 1)
        self.DeclareVectorOutputPort(
            "closure_commanded", 1, self._calc_closure, {self.state_ticket}
        )

    def sense(self, context):
        """Return what the inputs say."""
        return bool(self._grasped.Eval(context)[0])

    def _calc_closure(self, context, output):
        output[0] = self.state(context).memory


def main() -> list[str]:
    """Close on the bench's can; return the mode at every tenth of a second."""
    builder = DiagramBuilder()
    station = builder.AddSystem(MakeStation(load_scenario("gripper_bench")))
    cycle = builder.AddSystem(GraspCycle())
    # The hand, around the can [m].
    arm = builder.AddSystem(ConstantVectorSource([0.0, 0.0, 0.22]))
    for source, target in (
        (arm.get_output_port(), station.GetInputPort("arm.position_commanded")),
        (station.GetOutputPort("gripper.grasped"), cycle.GetInputPort("grasped")),
        (
            cycle.GetOutputPort("closure_commanded"),
            station.GetInputPort("gripper.closure_commanded"),
        ),
    ):
        builder.Connect(source, target)
    simulator = Simulator(builder.Build())
    context = cycle.GetMyContextFromRoot(simulator.get_context())
    modes = []
    for i in range(60):
        simulator.AdvanceTo(i / 10)
        modes.append(cycle.GetOutputPort("mode").Eval(context))
    return modes


if __name__ == "__main__":
    print(list(dict.fromkeys(main())))  # ['open', 'close', 'hold']
