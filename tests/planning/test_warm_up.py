"""Warming up compiles everything that a period calls."""

from motm_twin.model.reason import Kind
from motm_twin.planning.warm_up import warm_up_evasion, warm_up_foresight, warm_up_placement, warm_up_search


def test_warming_up_runs_both_parts() -> None:
    assert warm_up_placement().mode == "ring"
    warm_up_search()
    waits = warm_up_foresight().why
    assert waits is not None and waits.kind == Kind.GIVES_WAY
    assert warm_up_evasion().status == "escaping"
