"""The same code on a Ray cluster: two machines, one of which is lost in the middle."""

import threading
import time

import pytest
from own_process import run_in_this_process
from rich.console import Console

from motm_twin.perf.processes import wait_for
from motm_twin.studies.run import run
from motm_twin.studies.spec import Experiment, TrialSpec

from .made_results import SCENE

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'motm-twin[cluster]'")

DRIVES = Experiment("drives", "Half a metre", tuple(TrialSpec(SCENE, None, seed) for seed in range(6)))
NODE = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
SOON = {  # a machine that is lost is noticed within seconds, one that is only slow is kept
    "health_check_initial_delay_ms": 0,
    "health_check_period_ms": 200,
    "health_check_timeout_ms": 5000,
    "health_check_failure_threshold": 5,
}


@pytest.fixture
def cluster(monkeypatch):
    """Two nodes of one processor each, on this machine."""
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # no token in somebody's home
    made = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False, "_system_config": SOON})
    second = made.add_node(**NODE)
    try:
        yield made, second
    finally:
        ray.shutdown()
        made.shutdown()


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_sweep_that_loses_a_machine_gives_the_same_as_one_process_bit_for_bit(cluster, tmp_path, monkeypatch):
    made, second = cluster
    with monkeypatch.context() as patch:
        run_in_this_process(patch)
        run(DRIVES, out=tmp_path / "here", console=Console(quiet=True))
    store = tmp_path / "ray" / "drives" / "trials.jsonl"
    ended, lost = threading.Event(), threading.Event()

    def lose_a_machine():
        while not ended.is_set() and not (store.is_file() and store.stat().st_size):
            time.sleep(0.02)
        made.remove_node(second, allow_graceful=False)
        if not ended.is_set():
            lost.set()

    threading.Thread(target=lose_a_machine, daemon=True).start()
    options = {"workers": 2, "backend": "ray", "address": made.address}
    try:
        results = run(DRIVES, out=tmp_path / "ray", console=Console(quiet=True), **options)
    finally:
        ended.set()
    assert lost.is_set(), "the machine was not lost before the end of the sweep"
    assert results.computed == 6
    assert all(result["success"] for result in results.of("drives"))
    wait_for(lambda: sum(node["Alive"] for node in ray.nodes()) == 1, 60.0, "sign that Ray has noticed it")
    there, here = (tmp_path / name / "drives" / "results.jsonl" for name in ("ray", "here"))
    assert there.read_bytes() == here.read_bytes()
