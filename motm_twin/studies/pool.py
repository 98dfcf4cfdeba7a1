"""Calls on many processes, here or on a cluster: results as they come, no call lost with its process; efficiency.

A process that dies (killed, out of memory, a crash in compiled code, a lost machine) takes its current calls
with it. They are started again. The call that was to blame is not known, so after two losses a call runs alone, and
only a call that dies alone is given up. The same arguments must give the same result.
"""

import math
import os
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import joblib
import msgspec
from joblib.externals.loky.process_executor import TerminatedWorkerError
from rich.console import Console

from motm_twin.perf.report import Limit, Report, conclude, plain
from motm_twin.processes import deaf
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies.spec import Job, TrialSpec, job_of, run_job

BACKENDS = ("loky", "ray")
PATIENCE = 2  # losses after which a call runs alone: a lost machine is no call's fault


@dataclass(frozen=True, kw_only=True)
class Pool:
    """Processes that run calls. ``processes`` returns their present number: a cluster may have lost a machine."""

    backend: str  # of joblib
    processes: Callable[[], int]
    lost: tuple[type[Exception], ...]  # raised for a process that died
    options: dict[str, Any] = field(default_factory=dict)  # of the joblib backend


@dataclass(frozen=True)
class Lost:
    """Placeholder for a missing result: the process died even when the call ran alone."""

    reason: str


def local_pool(workers: int) -> Pool:
    """Processes on this machine. Raises ValueError for less than one."""
    if workers < 1:
        raise ValueError(f"{workers} workers: at least 1 is needed")
    return Pool(backend="loky", processes=lambda: workers, lost=(TerminatedWorkerError,))


def make_pool(workers: int, backend: str = "loky", address: str | None = None) -> Pool:
    """The pool of a backend; ``address`` is that of a Ray cluster. Raises ValueError."""
    if backend not in BACKENDS:
        raise ValueError(f"backend {backend!r}: use one of {', '.join(BACKENDS)}")
    if backend == "ray":
        return ray_pool(workers, address)
    if address is not None:
        raise ValueError(f"address {address!r}: only the backend ray has one; add --backend ray")
    return local_pool(workers)


def outcomes(
    call: Callable[..., Any], items: Sequence[Any], pool: Pool, report: Callable[[str], None] = lambda text: None
) -> Iterator[tuple[int, Any]]:
    """``(index, call(items[index]))`` of all items as they are done, in any order; `Lost` for a call given up.

    ``report`` is called with a sentence when processes were lost. Exceptions of ``call`` are raised here.
    """
    waiting, losses = list(range(len(items))), Counter[int]()
    while waiting:
        alone = next((index for index in waiting if losses[index] >= PATIENCE), None)
        chosen = waiting if alone is None else [alone]
        begun: list[int] = []
        done: set[int] = set()
        try:
            for index, outcome in _round(call, items, chosen, begun, pool):
                done.add(index)
                yield index, outcome
        except pool.lost as error:
            under_way = [index for index in begun if index not in done]
            losses.update(under_way)
            reason = _short(error)
            if alone is not None:
                done.add(alone)
                yield alone, Lost(f"the process died {losses[alone]} times, the last time while it ran alone: {reason}")
            else:
                report(f"a process died: {len(under_way)} trials that were under way are begun again ({reason})")
        waiting = [index for index in waiting if index not in done]


class Kept:
    """Results by name, one per line of a file: an interrupted benchmark continues from there.

    Results of another source are dropped, and so is a truncated line.
    """

    def __init__(self, file: Path) -> None:
        self._file, self._source = file, made_with()[SOURCE]
        lines = file.read_bytes().splitlines(keepends=True) if file.is_file() else []
        self.results: dict[str, dict[str, Any]] = {}
        for line in lines:
            with suppress(msgspec.DecodeError):
                source, name, result = msgspec.json.decode(line, type=tuple[str, str, dict[str, Any]])
                if source == self._source:
                    self.results[name] = result
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"".join(self._line(name, result) for name, result in self.results.items()))

    def add(self, name: str, result: dict[str, Any]) -> None:
        """Keep a result."""
        self.results[name] = plain(result)
        with self._file.open("ab") as file:
            file.write(self._line(name, self.results[name]))

    def _line(self, name: str, result: dict[str, Any]) -> bytes:
        return msgspec.json.encode((self._source, name, result)) + b"\n"


def printed_outcomes(
    call: Callable[..., dict[str, Any]], items: Sequence[Any], workers: int, console: Console, kept: Kept,
    about: Callable[[Any], str], verdict: Callable[[Any], str],
) -> list[dict[str, Any]]:  # fmt: skip
    """Outcomes on this machine in the order of the items, without lost ones; each is printed as it is done."""
    names = [about(item) for item in items]
    missing = [item for item, name in zip(items, names, strict=True) if name not in kept.results]
    if len(missing) < len(items):
        console.print(f"  {len(items) - len(missing)} of {len(items)} are known")
    for done, (index, outcome) in enumerate(outcomes(call, missing, local_pool(workers)), 1):
        progress = f"  {done}/{len(missing)} {about(missing[index])}"
        if isinstance(outcome, Lost):
            console.print(f"{progress}: lost, {outcome.reason}", style="red", markup=False)
        else:
            kept.add(about(missing[index]), outcome)
            console.print(f"{progress}: {verdict(outcome)}", markup=False)
    return [kept.results[name] for name in names if name in kept.results]


def _round(
    call: Callable[..., Any], items: Sequence[Any], chosen: list[int], begun: list[int], pool: Pool
) -> Iterator[tuple[int, Any]]:
    """Results until all are done or a process dies; indices of started calls are added to ``begun``."""

    def calls() -> Iterator[Any]:
        for index in chosen:
            begun.append(index)
            yield joblib.delayed(_one)(call, index, items[index])

    processes = pool.processes()
    # At least two processes: joblib runs the calls of a single one in this process, which a crash would end too.
    with joblib.parallel_config(backend=pool.backend, n_jobs=max(2, processes), **pool.options):
        options: dict[str, Any] = {"batch_size": 1, "pre_dispatch": min(processes, len(chosen)), "max_nbytes": None}
        parallel = joblib.Parallel(return_as="generator_unordered", **options)
        with deaf() if pool.backend == "loky" else nullcontext():  # Ray's processes ignore Ctrl-C anyway
            results: Any = parallel(calls())
    with warnings.catch_warnings():  # giving up calls after Ctrl-C or a crash is intended
        warnings.filterwarnings("ignore", message=".*tasks which were still being processed")
        try:
            yield from results
        finally:
            results.close()


def _one(call: Callable[..., Any], index: int, item: Any) -> tuple[int, Any]:
    """One call, in the worker."""
    return index, call(item)


def _short(error: Exception) -> str:
    """The informative part of a message: an exit code, or the actor."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    codes = [line for line in lines if "exit codes" in line]
    return f"{type(error).__name__}: {(codes or lines or [''])[0]}"


BACKEND = "motm_ray"


def ray_pool(workers: int, address: str | None) -> Pool:
    """Actors on a Ray cluster: at ``address``, or on a new cluster of this machine when there is none.

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
    """Number of processors of the machines that are present now."""
    return int(sum(node["Resources"].get("CPU", 0.0) for node in ray.nodes() if node["Alive"]))


def _idle_first() -> type:
    """Ray's backend of joblib, with three differences.

    Results are given as they come. Idle actors work first: Ray's own backend hands calls to its actors in turn, so that
    a long call makes others wait. And there may be a single actor, when one of two machines is lost.
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


NAME = "efficiency"
TITLE = "Trials of Experiment 1 on one process, two, and so on"
LIMITS = {"lost": Limit(name="efficiency lost on all processes", unit="%", limit=10.0, decimals=1)}
ROUNDS = 3  # trials per process: the last ones end apart, which costs up to the spread of one trial
MILLION = 1_000_000
HOUR = 3600.0  # [s]


def bench_efficiency(out: Path, workers: int, console: Console) -> bool:
    """Measure and print; True when at most 10 % are lost on ``workers`` processes. Nothing else may run then."""
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report = Report()
    specs = [TrialSpec("exp1", "random", seed) for seed in range(ROUNDS)]
    rates: dict[int, float] = {}
    for count in counts(workers):
        rates[count] = trials_per_hour(specs, count)
        share = rates[count] / (count * rates[1])
        report.details[f"{count} processes"] = {
            "trials_per_hour": rates[count],
            "trials_per_core_hour": rates[count] / count,
            "efficiency": share,
            "days_for_a_million": MILLION / rates[count] / 24.0,
        }
        console.print(f"  {count} processes: {rates[count]:.0f} trials/h, efficiency {100 * share:.1f} %", markup=False)
    report.values["lost"] = 100.0 * (1.0 - rates[workers] / (workers * rates[1])) if rates else math.nan
    return conclude(NAME, TITLE, LIMITS, report, out, console)


def counts(workers: int) -> Iterator[int]:
    """1, 2, 4, ... and ``workers``."""
    count = 1
    while count < workers:
        yield count
        count *= 2
    yield workers


def trials_per_hour(specs: Sequence[TrialSpec], processes: int) -> float:
    """Trials done per hour of wall time by warm processes: each process runs every spec once.

    So the work per process is the same for any number of processes.
    """
    jobs = [job_of(spec) for spec in specs]
    pool, there = local_pool(processes), max(2, processes)  # a pool has at least two processes; one may wait
    _all(jobs[:1] * there, local_pool(there))  # warm up: imports, kernels from the cache
    began = time.perf_counter()
    done = _all([job for job in jobs for _ in range(processes)], pool)
    return done * HOUR / (time.perf_counter() - began)


def _all(jobs: list[Job], pool: Pool) -> int:
    """Run jobs; returns their number. Raises RuntimeError for a failed one: its time would mean nothing."""
    for index, outcome in outcomes(run_job, jobs, pool):
        if isinstance(outcome, Lost) or not outcome.result["success"]:
            reason = outcome.reason if isinstance(outcome, Lost) else outcome.result["reason"]
            raise RuntimeError(f"{jobs[index].scene.name} seed {jobs[index].scene.seed}: {reason}")
    return len(jobs)
