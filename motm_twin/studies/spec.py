"""A trial: a scene, a seed, a method, changes of either, and its outcome. An experiment is a list of trials.

Changes are dotted names of a resolved scene, as ``noise.lidar_range_sd`` or ``agents.temi_1.speed``. Units are those of
the resolved scene (`model.scene`): m, rad, s. Lists are indexed by an entry's name, or by ``*`` for all entries. Each
value, and the scene afterwards, must be one that a scene file could have given.
"""

import dataclasses
import functools
import hashlib
import time
import traceback
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from motm_twin.control.method import Method
from motm_twin.control.parameters import Parameters
from motm_twin.control.tick import Tick
from motm_twin.control.tuning import PARAMETERS, check, parameter, tuned
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import ParameterValue
from motm_twin.model.names import hint
from motm_twin.model.number import numbers_of, replaced
from motm_twin.model.plant import PERIODS_PER_SECOND
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_document, scene_of
from motm_twin.perf.report import machine
from motm_twin.plants import with_plant
from motm_twin.sessions.scene_limits import check_scene
from motm_twin.sessions.session import SOURCE, Session, SessionError, made_with


def changed(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """The scene with these fields changed. Raises ValueError that names the field, and what is allowed."""
    if not changes:
        return scene
    for name, value in changes.items():
        scene = _set(scene, name.split("."), value, name)
    try:
        check_scene(scene)
    except SessionError as error:
        raise ValueError(f"change {', '.join(map(repr, changes))}: {error.problem}") from error
    return scene


def _set(owner: Any, path: list[str], value: Any, whole: str) -> Any:
    """A copy of nested frozen objects with the value at the path replaced."""
    here, *rest = path
    if isinstance(owner, tuple):
        return _set_entries(owner, path, value, whole)
    fields = {field.name: field for field in msgspec.structs.fields(owner)} if isinstance(owner, msgspec.Struct) else {}
    if here not in fields:
        raise ValueError(f"change {whole!r}: there is no field {here!r}; {hint(here, fields)}")
    if rest:
        return msgspec.structs.replace(owner, **{here: _set(getattr(owner, here), rest, value, whole)})
    try:
        # through JSON's types, so that stored lines and callers may give the same values
        converted = msgspec.convert(msgspec.to_builtins(value), fields[here].type)
    except msgspec.ValidationError as error:
        raise ValueError(f"change {whole!r}: {error}") from error
    return msgspec.structs.replace(owner, **{here: converted})


def _set_entries(entries: tuple[Any, ...], path: list[str], value: Any, whole: str) -> tuple[Any, ...]:
    here, *rest = path
    names = [getattr(entry, "name", str(index)) for index, entry in enumerate(entries)]
    if here != "*" and here not in names:
        raise ValueError(f"change {whole!r}: nothing is called {here!r} there; {hint(here, names)}")
    if not rest:
        raise ValueError(f"change {whole!r}: name a field of {here!r}, as {whole}.speed")
    chosen = [here in ("*", name) for name in names]
    return tuple(_set(entry, rest, value, whole) if on else entry for entry, on in zip(entries, chosen, strict=True))


KEY_DIGITS = 16


class TrialSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One trial: everything on which its result depends, besides the source.

    ``parameters`` are of `control.tuning`, on top of the method's; ``changes`` are dotted fields of the resolved scene
    with their new values, as ``{"noise.lidar_range_sd": 0.05, "agents.temi_1.speed": 0.6}``; ``numbers`` are those of
    `control.parameters` by their paths, over the method's, even beyond the range of sliders.
    """

    scene: str
    variant: str | None = None  # None: the scene's default
    seed: int | None = None  # None: the seed of the scene file
    method: str = "motm"
    parameters: dict[str, ParameterValue] = {}
    changes: dict[str, Any] = {}
    numbers: dict[str, float | bool] = {}
    plant: str = "simulated"  # one of `plants.PLANTS`


class Experiment(msgspec.Struct, frozen=True):
    """Trials that belong together; the name is also the folder of their results."""

    name: str
    title: str
    specs: tuple[TrialSpec, ...]

    def changed(self, changes: Mapping[str, Any]) -> "Experiment":
        """The same trials with these fields of their scenes also changed."""
        specs = (msgspec.structs.replace(spec, changes={**spec.changes, **changes}) for spec in self.specs)
        return msgspec.structs.replace(self, specs=tuple(specs))

    def on(self, plant: str) -> "Experiment":
        """The same trials with another plant."""
        return msgspec.structs.replace(
            self, specs=tuple(msgspec.structs.replace(one, plant=plant) for one in self.specs)
        )


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """A checked spec with its changed scene, as sent to a worker."""

    spec: TrialSpec
    scene: Scene
    method_text: str = ""  # contents of the user's own file when the method is FILE.py:NAME

    def key(self, source: str) -> str:
        """Name of this trial in the store; it depends on scene, parameters, method and source."""
        whole = hashlib.sha256(source.encode())
        for part in (self.spec.method, self.spec.parameters, self.scene, self.method_text):
            whole.update(b"\0" + msgspec.json.encode(part, order="deterministic"))
        if self.spec.numbers:
            whole.update(b"\0" + msgspec.json.encode(self.spec.numbers, order="deterministic"))
        return whole.hexdigest()[:KEY_DIGITS]


def job_of(spec: TrialSpec) -> Job:
    """The checked job of a spec. Raises ValueError (SceneError, MethodError) that names what is wrong."""
    return jobs_of([spec])[0]


def jobs_of(specs: Iterable[TrialSpec]) -> list[Job]:
    """The checked jobs of many specs; each file is read once, each scene resolved and changed once."""
    document = functools.lru_cache(load_document)  # of the last 128: generated scenes have one for each seed

    @functools.cache
    def load(name: str, variant: str | None, seed: int | None) -> Scene:
        return scene_of(document(name), variant, seed)

    scenes: dict[bytes, Scene] = {}
    jobs = []
    for spec in specs:
        which = msgspec.json.encode((spec.scene, spec.variant, spec.seed, spec.plant, spec.changes))
        if which not in scenes:
            scene = with_plant(load(spec.scene, spec.variant, spec.seed), spec.plant)
            scenes[which] = changed(scene, spec.changes)
        jobs.append(_job(spec, scenes[which]))
    return jobs


def _job(spec: TrialSpec, scene: Scene) -> Job:
    method = find_method(spec.method)
    if spec.numbers:
        with_numbers(method, spec.numbers)
    parameters = {name: check(name, value) for name, value in spec.parameters.items()}
    spec = msgspec.structs.replace(spec, parameters=parameters)
    file, colon, _ = spec.method.rpartition(":")
    return Job(spec=spec, scene=scene, method_text=Path(file).read_text(encoding="utf-8") if colon else "")


def with_numbers(method: Method, numbers: Mapping[str, float | bool]) -> Parameters:
    """The numbers of a method with some of them changed. Raises ValueError for an unknown or impossible number."""
    whole = tuned(method.parameters)
    known = {".".join(found.path): found for found in numbers_of(whole)}
    for name, value in numbers.items():
        if name not in known:
            raise ValueError(f"there is no number {name!r}; {hint(name, known)}")
        found = known[name]
        whole = replaced(whole, found.path, type(found.default)(value))
    return whole


def method_of(job: Job) -> Method:
    """The method of a job, without its own values for numbers that the job changes. Raises MethodError."""
    method, changed = find_method(job.spec.method), job.spec.numbers
    if not changed:
        return method
    given = {entry.name for entry in PARAMETERS if ".".join(entry.path) in changed}
    kept = {name: value for name, value in method.parameters.items() if name not in given}
    return dataclasses.replace(method, parameters=kept)


WALL = ("tick_ms", "realtime_factor")  # measured by a clock, so they differ between runs
MACHINE = "machine"  # key of the machine on which a trial was run, beside its versions


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a trial as a worker sends it."""

    result: dict[str, Any]
    made_with: dict[str, str]  # versions of the worker
    session: Session | None  # only of a trial without success

    @property
    def source(self) -> str:
        """Hash of the worker's source."""
        return self.made_with[SOURCE]


def run_job(job: Job) -> Outcome:
    """Run a trial to its end; never raises for an error inside it."""
    from motm_twin.trial import run_scene  # imports the whole twin

    periods = 0

    def on_tick(tick: Tick) -> None:
        nonlocal periods
        periods = tick.index + 1

    began = time.perf_counter()
    try:
        numbers = with_numbers(find_method(job.spec.method), job.spec.numbers) if job.spec.numbers else None
        result = run_scene(
            job.scene, on_tick=on_tick, method=method_of(job), parameters=dict(job.spec.parameters), numbers=numbers
        )
    except Exception as error:  # one broken trial must not cost the others
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        result = broken(job, reason, time_s=periods / PERIODS_PER_SECOND)
    result = parted(job, result, time.perf_counter() - began)
    repeats = not job.spec.numbers  # a session has only named parameters
    session = None if result["success"] or not repeats else session_of(job, periods, result.get("state_hash", ""))
    return Outcome(result=result, made_with={**made_with(), MACHINE: machine()}, session=session)


def given_up(job: Job, reason: str, source: str) -> Outcome:
    """The outcome of a trial whose process died: its session has the scene's time limit, and no hash."""
    periods = round(job.scene.time_limit * PERIODS_PER_SECOND)
    return Outcome(
        result=parted(job, broken(job, reason), 0.0),
        made_with={**made_with(), SOURCE: source, MACHINE: machine()},
        session=None if job.spec.numbers else session_of(job, periods, ""),
    )


def parted(job: Job, result: dict[str, Any], seconds: float) -> dict[str, Any]:
    """A result with its spec, and wall-clock measurements in a separate part."""
    rest = {key: value for key, value in result.items() if key not in WALL}
    wall = {key: result[key] for key in WALL if key in result}
    spec = job.spec
    given = {"parameters": dict(spec.parameters), "changes": dict(spec.changes), "numbers": dict(spec.numbers)}
    return {**rest, "method": spec.method, **given, "wall": {**wall, "seconds": round(seconds, 3)}}


def session_of(job: Job, periods: int, state_hash: str) -> Session:
    """A session with which `motm-twin rerun` repeats the trial."""
    method = method_of(job)
    start = {**method.parameters, **job.spec.parameters}
    return Session(
        title=f"{job.scene.title}, {job.spec.method}", made_with=made_with(physics=job.scene.physics is not None),
        scene=job.scene, method=method.name,
        parameters={name: value for name, value in start.items() if value != parameter(name).default}, periods=periods,
        state_hash=state_hash,
    )  # fmt: skip


def broken(job: Job, reason: str, *, time_s: float = 0.0) -> dict[str, Any]:
    """The placeholder result of a broken trial."""
    picks = sum(type(task).__name__ == "Pick" for task in job.scene.tasks)
    return {
        "scene": job.scene.name, "variant": job.scene.variant, "seed": job.scene.seed, "success": False,
        "time_s": time_s, "reference_tour_s": None, "picks_done": 0, "picks_attempted": 0, "picks_total": picks,
        "places_done": 0, "places_total": picks, "drops": 0, "dropped": [], "contacts": [],
        "contacts_caused_by_robot": 0, "cut_ins": [], "min_base_clearance_m": None, "min_arm_clearance_m": None,
        "min_ee_obstacle_m": None, "path_length_m": 0.0, "mean_closing_base_speed_mps": None, "encounters": 0,
        "plant_faults": [], "reason": reason, "state_hash": "", "measures": None,
    }  # fmt: skip
