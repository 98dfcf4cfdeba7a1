"""Nothing is left to compile in a run after the parts that the first start compiles at the same time."""

import json
import subprocess
import sys

CODE = """
import gc, json, sys
from motm_twin import warm_up

def called():  # kernels with the types that Python has called them with
    found = set()
    for each in gc.get_objects():
        if type(each).__name__ == "CPUDispatcher" and each.py_func.__module__.startswith("motm_twin"):
            stats = each.stats
            found |= {(each.py_func.__qualname__, str(types)) for types in (*stats.cache_hits, *stats.cache_misses)}
    return found

for part in warm_up.PARTS.values():
    part()
warm = called()
from motm_twin.methods.registry import FAST
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin
for scene, periods in (("exp1", 350), ("exp2", 250)):
    twin = Twin(load_scene(scene), method=FAST)
    for _ in range(periods):
        twin.advance()
print(json.dumps(sorted(name for name, _ in called() - warm)))
"""


def test_a_run_calls_no_kernel_that_the_first_start_has_not_compiled() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, timeout=300, check=True)
    assert json.loads(done.stdout) == []
