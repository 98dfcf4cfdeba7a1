"""The photographed twin is at the moment that was asked for, however late in the run it is."""

from motm_twin.bus.ranges import MAX_STEPS
from motm_twin.perf.processes import served
from motm_twin.studies.paper import snapshots


def test_a_twin_is_stepped_beyond_what_one_command_allows() -> None:
    late = MAX_STEPS + 10
    with served("exp1", "--expansions-only") as twin:
        snapshots._rewind(twin.client)
        snapshots._step_to(twin.client, late)
        tick, status = twin.client.tick(), twin.client.status()
    assert tick is not None
    assert status is not None
    assert (tick.index, status.state) == (late, "paused")
