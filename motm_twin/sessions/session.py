"""A session: all that is needed to repeat a run bit for bit, as one JSON file; and the versions that a run depends on.

The file is only data: names in it are never opened, imported or run. A file that does not fit is refused with a
`SessionError` that says where and why.
"""

import functools
import hashlib
import itertools
import os
import platform
import re
import tempfile
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from motm_twin.methods import UNNAMED_METHOD
from motm_twin.model.edits import EDITS, Edit, ParameterValue
from motm_twin.model.names import SceneError
from motm_twin.model.scene import Scene

PACKAGES = (
    "motm-twin", "numpy", "scipy", "numba", "llvmlite", "pin", "coal", "shapely", "daqp", "osqp", "qpsolvers",
)  # fmt: skip
MUJOCO = "mujoco"  # only of runs with contact dynamics
SOURCE = "source"  # key of the hash of this package's source; earlier files have none
PACKAGE = Path(__file__).parents[1]


@functools.cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}
    found["system"] = " ".join(part for part in (platform.system(), platform.machine(), *platform.libc_ver()) if part)
    # The vector instructions of numpy, which determine its order of summation; a dict in this mode.
    vectors = np.show_config(mode="dicts")["SIMD Extensions"]  # type: ignore[index]
    found["processor"] = " ".join([*vectors.get("baseline", []), *vectors.get("found", [])])
    found[SOURCE] = source_hash(PACKAGE)
    return found


def source_hash(package: Path) -> str:
    """First 12 digits of the SHA-256 over names and contents of all Python files of a package."""
    whole = hashlib.sha256()
    for name in sorted(file.relative_to(package).as_posix() for file in package.rglob("*.py")):
        content = (package / name).read_bytes()
        whole.update(f"{name} {len(content)}\n".encode() + content)
    return whole.hexdigest()[:12]


def made_with(*, physics: bool = False) -> dict[str, str]:
    """Versions, by name, of everything that can change a number or its last bit; ``physics``: MuJoCo's, too."""
    return {**_versions(), **({MUJOCO: _version(MUJOCO)} if physics else {})}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed as a package"


def differences(recorded: dict[str, str]) -> tuple[str, ...]:
    """One phrase for each difference: "numpy 2.3.0 there, 2.4.6 here"."""
    here = made_with(physics=MUJOCO in recorded)
    names = [*here, *(name for name in recorded if name not in here)]
    pairs = [(name, recorded.get(name, "nothing"), here.get(name, "nothing")) for name in names if name != SOURCE]
    then, now = recorded.get(SOURCE, here[SOURCE]), here[SOURCE]
    other = () if then == now else (f"recorded with another motm_twin ({then} → {now})",)
    return (*other, *(f"{name} {there} there, {now} here" for name, there, now in pairs if there != now))


SESSION_VERSION = "motm.session/1"
MCAP_MAGIC = b"\x89MCAP"  # first bytes of every recording
MAX_BYTES = 50 * 1024 * 1024
MAX_VALUES = 1_000_000  # numbers, texts, lists and objects; twice as many as in an hour of dragging
MAX_PERIODS = 20 * 7 * 86_400  # a week
MAX_EXPANSIONS = 10_000
MAX_TEXT = 2_000  # characters of the title
MAX_EDITS_PER_PERIOD = 50_000  # hours of dragging while the twin is paused
E = TypeVar("E", bound=msgspec.Struct)


class SessionError(ValueError):
    """A session that cannot be used; ``str()`` of it is one line for the person who has the file."""

    def __init__(self, problem: str, *, file: str = "") -> None:
        self.problem, self.file = problem, file
        text = f"{file}: {problem}" if file else problem
        super().__init__("".join(letter if letter.isprintable() else "?" for letter in text))


class LoggedEdit(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An edit, and the period at whose start it was applied."""

    index: int
    edit: Edit


class Cut(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A search that had another number of expansions than usual, for example by the clock: its period and number."""

    index: int
    expansions: int


class Session(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A run up to the end of period ``periods - 1``, and the hash of its state there."""

    version: str = SESSION_VERSION
    title: str = ""
    made_with: dict[str, str] = msgspec.field(default_factory=made_with)  # versions, to explain another hash
    scene: Scene  # resolved: a later change of the scene file does not change the session
    method: str = UNNAMED_METHOD  # of `methods.registry`, or what a user's own is named, which a rerun is then given
    # Of `control.tuning`, the method's included, set before the first period.
    parameters: dict[str, ParameterValue] = {}
    edits: tuple[LoggedEdit, ...] = ()
    cuts: tuple[Cut, ...] = ()
    periods: int = 0
    state_hash: str = ""  # "" when the state is unknown: the next period failed
    parts: dict[str, str] = {}  # part of the twin: first digits of its own hash, to tell which one differs
    track: tuple[tuple[float, float, float], ...] = ()  # true base pose after each second, to tell where a rerun parts


def load_session(path: str | Path) -> Session:
    """The session in a file. Raises SessionError."""
    path = Path(path)
    try:
        if not path.is_file():
            raise SessionError("there is no such file: give the path of a saved session", file=str(path))
        with path.open("rb") as file:
            recording = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
        if recording:
            hint = "give a session, which `run --save`, `send save` or the page make (`rerun` takes FILE.mcap too)"
            raise SessionError(f"is a recording: {hint}", file=str(path))
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise SessionError(f"{size / 1e6:.0f} MB is no session: at most {MAX_BYTES / 1e6:.0f} MB", file=str(path))
        data = path.read_bytes()
    except SessionError:
        raise
    except (OSError, ValueError) as error:
        raise SessionError(f"cannot be read: {error}", file=str(path)) from error
    return decode_session(data, file=str(path))


def save_session(session: Session, path: str | Path) -> None:
    """Write a session atomically: the file is either the old or the new one, never half of it. Raises SessionError."""
    path = Path(path)
    temporary = ""
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = file.name
            file.write(encode_session(session))
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise SessionError(f"cannot be written: {error.strerror or error}", file=str(path)) from error


def encode_session(session: Session) -> bytes:
    """The session as readable JSON, one edit, cut or body of the scene a line; equal sessions give equal bytes."""
    return (_lines(msgspec.to_builtins(session), depth=0) + "\n").encode()


def decode_session(data: bytes, *, file: str = "") -> Session:
    """The session in these bytes, checked. Raises SessionError; ``file``: name of the file in its message."""
    if len(data) > MAX_BYTES:
        raise SessionError(f"{len(data) / 1e6:.0f} MB is no session: at most {MAX_BYTES / 1e6:.0f} MB", file=file)
    values = sum(data.count(mark) for mark in (b",", b"[", b"{"))
    if values > MAX_VALUES:  # each takes some hundred bytes of memory
        raise SessionError(f"has {values:,} values: at most {MAX_VALUES:,} are taken", file=file)
    try:
        raw = msgspec.json.decode(data)
        _check_version(raw)
        session = msgspec.convert(raw, Session)
        _refuse_unknown(raw, msgspec.to_builtins(session), "session")
        check_session(session)
    except SessionError as error:
        raise SessionError(error.problem, file=file) from error
    except RecursionError as error:
        raise SessionError("is nested too deeply to be a session", file=file) from error
    except msgspec.ValidationError as error:
        raise SessionError(f"is not a session: {error}", file=file) from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        cure = "give a .json of `run --save`, or a .mcap"
        raise SessionError(f"is neither a session nor a recording: {error}; {cure}", file=file) from error
    return session


def check_session(session: Session) -> None:
    """Raise SessionError for numbers out of bounds or order, or a scene that no scene file could have made."""
    from motm_twin.sessions.scene_limits import check_scene  # shapely: only where a file is read

    _check_numbers(session)
    try:
        check_scene(session.scene)
    except SceneError as error:
        raise SessionError(": ".join(part for part in (error.place, error.problem) if part)) from error


def _check_version(raw: Any) -> None:
    if not isinstance(raw, dict) or "version" not in raw:
        raise SessionError("is not a session: it must be a JSON object with a 'version'")
    if raw["version"] != SESSION_VERSION:
        shown = repr(raw["version"])[:60]
        raise SessionError(f"has version {shown}, this program reads {SESSION_VERSION!r}: use the motm-twin it is from")
    if "made_with" not in raw:
        raise SessionError("the key 'made_with' is missing: save the session again")


def _refuse_unknown(raw: Any, known: Any, place: str) -> None:
    """Refuse unknown keys: an ignored one might change the run."""
    if isinstance(raw, dict) and isinstance(known, dict):
        for key, item in raw.items():
            if key not in known:
                raise SessionError(f"{place}: unknown key {key[:60]!r}; allowed: {', '.join(known)}")
            _refuse_unknown(item, known[key], f"{place}.{key}")
    elif isinstance(raw, list):
        for index, (item, of) in enumerate(zip(raw, known, strict=False)):
            _refuse_unknown(item, of, f"{place}[{index}]")


def _check_numbers(session: Session) -> None:
    """Check that periods, indices and texts are within bounds and in order."""
    if not 0 <= session.periods <= MAX_PERIODS:
        raise SessionError(f"periods must be 0 to {MAX_PERIODS}, got {session.periods}")
    if len(session.title) > MAX_TEXT:
        raise SessionError(f"the title has {len(session.title)} characters: at most {MAX_TEXT}")
    if session.state_hash and not re.fullmatch("[0-9a-f]{64}", session.state_hash):
        raise SessionError("state_hash must be 64 hexadecimal digits")
    for what, entries in (("edits", session.edits), ("cuts", session.cuts)):
        for place, entry in enumerate(entries):
            if not 0 <= entry.index < session.periods:
                raise SessionError(
                    f"{what}[{place}].index is {entry.index}: the session has the periods 0 to {session.periods - 1}"
                )
        for place, (one, other) in enumerate(itertools.pairwise(entries)):
            if other.index < one.index or (what == "cuts" and other.index == one.index):
                raise SessionError(f"{what}[{place + 1}].index {other.index} comes after {one.index}: sort them")
    for place, cut in enumerate(session.cuts):
        if not 0 <= cut.expansions <= MAX_EXPANSIONS:
            raise SessionError(f"cuts[{place}].expansions must be 0 to {MAX_EXPANSIONS}, got {cut.expansions}")
    for index, group in itertools.groupby(session.edits, key=lambda entry: entry.index):
        if sum(1 for _ in group) > MAX_EDITS_PER_PERIOD:
            raise SessionError(f"period {index} has more than {MAX_EDITS_PER_PERIOD} edits")


def _lines(value: Any, depth: int) -> str:
    """JSON with one entry a line where the entries are objects."""
    if isinstance(value, dict) and depth < 2 and value:
        inner = ",\n".join(f"{_text(key)}: {_lines(item, depth + 1)}" for key, item in value.items())
        return "{\n" + inner + "\n}"
    if isinstance(value, (list, tuple)) and value and isinstance(value[0], (dict, list, tuple)) and depth < 3:
        return "[\n" + ",\n".join(_text(item) for item in value) + "\n]"
    return _text(value)


def _text(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def plain(edit: E) -> E:
    """The edit with plain Python values, as if it were read from a session; raises ValueError for anything else.

    A recorded run and its repetition then have the same values and types.
    """
    if not isinstance(edit, EDITS):
        raise ValueError(f"{type(edit).__name__} is no edit: use one of {', '.join(kind.__name__ for kind in EDITS)}")
    try:
        return msgspec.convert(msgspec.to_builtins(edit, enc_hook=_of_numpy), type(edit))
    except (TypeError, msgspec.MsgspecError) as error:
        raise ValueError(f"{type(edit).__name__} cannot be taken: {error}") from error


def _of_numpy(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is neither a number nor a text nor made of them")
