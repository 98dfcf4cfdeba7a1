"""Ray behind joblib: the same calls on the machines of a cluster. Needs the extra ``cluster``."""

import os
import threading
from collections.abc import Callable
from typing import Any

import joblib

from motm_twin.bench.experiments.pool import Pool

BACKEND = "motm_ray"


def ray_pool(workers: int, address: str | None) -> Pool:
    """Actors on a Ray cluster: at ``address``, or one of this machine's own when there is none.

    At most as many as the cluster has processors. Raises ValueError when Ray is not installed or not reached.
    """
    try:
        import ray
        from ray.exceptions import RayError
        from ray.util.joblib import register_ray
    except ImportError as error:
        raise ValueError("the backend ray needs Ray: pip install 'motm-twin[cluster]'") from error
    if workers < 1:
        raise ValueError(f"{workers} workers: at least 1 is needed")
    if not ray.is_initialized():
        try:
            ray.init(
                address=address,
                log_to_driver=False,
                num_cpus=None if address or "RAY_ADDRESS" in os.environ else workers,
            )
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise ValueError(f"no Ray cluster is reached at {address!r}: {error}") from error
    register_ray()
    joblib.register_parallel_backend(BACKEND, _idle_first())
    remote = {"num_cpus": 1, "scheduling_strategy": "SPREAD"}
    return Pool(
        backend=BACKEND,
        processes=lambda: max(1, min(workers, _processors(ray))),
        lost=(RayError,),
        options={"ray_remote_args": remote},
    )


def _processors(ray: Any) -> int:
    """Processors of the machines that are there now."""
    return int(sum(node["Resources"].get("CPU", 0.0) for node in ray.nodes() if node["Alive"]))


def _idle_first() -> type:
    """Ray's backend of joblib, with three differences.

    Results are given as they come. Idle actors work first: Ray's own hands calls to its actors in turn, so that one
    with a long call makes others wait. And there may be one actor only, when one machine of two is gone.
    """
    import ray
    from ray.util.joblib.ray_backend import RayBackend
    from ray.util.multiprocessing.pool import Pool as Actors

    class IdleFirst(RayBackend):
        supports_return_generator = True

        def configure(self, n_jobs: int = 1, parallel: Any = None, *_: Any, **options: Any) -> int:
            count = min(n_jobs, _processors(ray))
            self._pool: Any = Actors(count, ray_remote_args=options.get("ray_remote_args") or self.ray_remote_args)
            self._busy: set[int] = set()
            self._choosing = threading.Lock()
            self.parallel = parallel
            return n_jobs

        def submit(self, func: Any, callback: Callable[[Any], None] | None = None) -> Any:
            with self._choosing:
                actors = range(len(self._pool._actor_pool))
                chosen = next((actor for actor in actors if actor not in self._busy), 0)
                self._busy.add(chosen)
                self._pool._current_index = chosen - 1  # it takes the next one

                def done(result: Any) -> None:
                    self._busy.discard(chosen)
                    if callback is not None:
                        callback(result)

                return super().submit(func, done)

    return IdleFirst
