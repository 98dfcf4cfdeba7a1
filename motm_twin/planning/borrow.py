"""Views without reference counts, for kernels that hand many arrays to small functions.

Numba counts references to every array of a tuple at every call, which costs more than the work of a search node. A
borrowed view has no owner to count; it is valid as long as the caller holds the original, that is, during the call.
"""

from typing import Any

from llvmlite import ir
from numba import carray, njit, types
from numba.extending import intrinsic

from motm_twin.planning.collision import Body, Field
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.visibility import Graph, Rings


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:  # noqa: ARG001
    """An integer address as an untyped pointer."""

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
        return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())

    return types.voidptr(address), generate


@njit(cache=True)
def borrowed(array: Any) -> Any:
    """A view of a C-contiguous array."""
    return carray(_pointer(array.ctypes.data), array.shape, array.dtype)


@njit(cache=True)
def _borrowed_rings(rings: Rings) -> Rings:
    return Rings(borrowed(rings.point), borrowed(rings.start), borrowed(rings.box))


@njit(cache=True)
def borrowed_graph(graph: Graph) -> Graph:
    """A graph of borrowed arrays."""
    return Graph(
        borrowed(graph.vertex), borrowed(graph.before), borrowed(graph.after), _borrowed_rings(graph.walls),
        _borrowed_rings(graph.solids), borrowed(graph.out_start), borrowed(graph.edge_from), borrowed(graph.edge_to),
        borrowed(graph.edge_length), borrowed(graph.edge_angle), borrowed(graph.in_start), borrowed(graph.in_edge),
    )  # fmt: skip


@njit(cache=True)
def borrowed_table(table: Table) -> Table:
    """A table of borrowed arrays."""
    return Table(
        borrowed(table.site), borrowed(table.seen), borrowed(table.extra), borrowed(table.goal_start),
        borrowed(table.goal_heading), borrowed(table.goal_offset), borrowed(table.exit_start),
        borrowed(table.exit_site), borrowed(table.exit_angle), borrowed(table.exit_front), borrowed(table.exit_back),
        borrowed(table.front), borrowed(table.back), borrowed(table.next_front), borrowed(table.next_back),
        borrowed(table.bound), table.rates,
    )  # fmt: skip


@njit(cache=True)
def borrowed_field(field: Field) -> Field:
    """A field of borrowed values."""
    return Field(borrowed(field.value), field.x, field.y, field.inverse_cell)


@njit(cache=True)
def borrowed_body(body: Body) -> Body:
    """A footprint of borrowed circles."""
    return Body(borrowed(body.circle), borrowed(body.corner), body.centre_x, body.outer, body.inner)
