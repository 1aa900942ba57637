"""The output ports that all planners share."""

from collections.abc import Callable

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DependencyTicket

from drake_srg.lifetime import LeafSystem
from drake_srg.types import PlannerStatus


def AddPlannerOutputs(
    planner: LeafSystem,
    num_joints: int,
    *,
    position: Callable[[Context, BasicVector], None],
    closure: Callable[[Context, BasicVector], None],
    status: Callable[[Context, AbstractValue], None],
    prerequisites: set[DependencyTicket],
) -> None:
    """Add a planner's outputs `position_commanded`, `closure_commanded`, `status`.

    Args:
        planner: The planner; it declares its `mode` itself.
        num_joints: Of the arm.
        position: Calculates the joint positions (num_joints) [rad or m]. They also
            depend on time.
        closure: Calculates the closure (1), 0 open .. 1 closed.
        status: Calculates the `PlannerStatus`.
        prerequisites: What all three depend on.
    """
    for name, size, calc, tickets in (
        ("position_commanded", num_joints, position, {planner.time_ticket()}),
        ("closure_commanded", 1, closure, set()),
    ):
        planner.DeclareVectorOutputPort(
            name=name,
            size=size,
            calc=calc,
            prerequisites_of_calc=prerequisites | tickets,
        )
    planner.DeclareAbstractOutputPort(
        name="status",
        alloc=lambda: AbstractValue.Make(PlannerStatus()),
        calc=status,
        prerequisites_of_calc=prerequisites,
    )
