"""Nothing is left to compile in a run after the parts that its first start compiles."""

import json
import subprocess
import sys

import pytest

CODE = """
import gc, json, sys
from motm_twin import warm_up
from motm_twin.methods.registry import find_method
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

def called():  # kernels with the types that Python has called them with
    found = set()
    for each in gc.get_objects():
        if type(each).__name__ == "CPUDispatcher" and each.py_func.__module__.startswith("motm_twin"):
            stats = each.stats
            found |= {(each.py_func.__qualname__, str(types)) for types in (*stats.cache_hits, *stats.cache_misses)}
    return found

method, runs, new = find_method(sys.argv[1]), json.loads(sys.argv[2]), set()
for agents, group in runs.items():
    for part in warm_up.parts_of(method.parameters, agents=agents == "agents"):
        warm_up.PARTS[part].compile()
    warm = called()
    for scene, periods in group.items():
        twin = Twin(load_scene(scene), method=method)
        for _ in range(periods):
            twin.advance()
    new |= called() - warm
print(json.dumps(sorted(name for name, _ in new)))
"""


@pytest.mark.parametrize(
    ("method", "runs"),
    [
        ("fast", {"nobody": {"exp1": 350}, "agents": {"exp2": 250}}),  # at first without the kernels of agents
        ("foresight", {"agents": {"exp1": 100, "exp2": 600}}),
    ],
)
def test_a_run_calls_no_kernel_that_the_first_start_has_not_compiled(
    method: str, runs: dict[str, dict[str, int]]
) -> None:
    command = [sys.executable, "-c", CODE, method, json.dumps(runs)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert json.loads(done.stdout) == []
