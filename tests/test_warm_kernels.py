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

method, runs = find_method(sys.argv[1]), json.loads(sys.argv[2])
scenes = [load_scene(scene) for scene, _ in runs]
for part in warm_up.parts_of(method.parameters, agents=any(scene.agents for scene in scenes)):
    warm_up.PARTS[part].compile()
warm = called()
for scene, (_, periods) in zip(scenes, runs):
    twin = Twin(scene, method=method)
    for _ in range(periods):
        twin.advance()
print(json.dumps(sorted(name for name, _ in called() - warm)))
"""


@pytest.mark.parametrize(
    ("method", "runs"),
    [
        ("fast", (("exp1", 350),)),  # without the kernels of agents
        ("fast", (("exp1", 350), ("exp2", 250))),
        ("foresight", (("exp1", 100), ("exp2", 600))),
    ],
)
def test_a_run_calls_no_kernel_that_the_first_start_has_not_compiled(
    method: str, runs: tuple[tuple[str, int], ...]
) -> None:
    command = [sys.executable, "-c", CODE, method, json.dumps(runs)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert json.loads(done.stdout) == []
