"""Origin of a run, besides the session: this package's source, the numeric libraries, and the machine."""

import functools
import hashlib
import platform
from importlib import metadata
from pathlib import Path

import numpy as np

PACKAGES = (
    "motm-twin", "numpy", "scipy", "numba", "llvmlite", "pin", "coal", "shapely", "daqp", "osqp", "qpsolvers",
)  # fmt: skip
SOURCE = "source"  # key of the hash of this package's source; files of before have none
PACKAGE = Path(__file__).parents[1]


@functools.cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed as a package"
    found["system"] = " ".join(part for part in (platform.system(), platform.machine(), *platform.libc_ver()) if part)
    found["processor"] = _processor()
    found[SOURCE] = source_hash(PACKAGE)
    return found


def source_hash(package: Path) -> str:
    """First 12 digits of the SHA-256 over names and contents of all Python files of a package."""
    whole = hashlib.sha256()
    for name in sorted(file.relative_to(package).as_posix() for file in package.rglob("*.py")):
        content = (package / name).read_bytes()
        whole.update(f"{name} {len(content)}\n".encode() + content)
    return whole.hexdigest()[:12]


def made_with() -> dict[str, str]:
    """Name to version of everything here that can change a number, or its last bit."""
    return dict(_versions())


def _processor() -> str:
    """The vector instructions that numpy found: with others it adds in another order."""
    found = np.show_config(mode="dicts")["SIMD Extensions"]  # type: ignore[index] - a dict in this mode
    return " ".join([*found.get("baseline", []), *found.get("found", [])])


def differences(recorded: dict[str, str]) -> tuple[str, ...]:
    """One phrase for each thing that is not here as it was there: "numpy 2.3.0 there, 2.4.6 here"."""
    here = made_with()
    names = [*here, *(name for name in recorded if name not in here)]
    pairs = [(name, recorded.get(name, "nothing"), here.get(name, "nothing")) for name in names if name != SOURCE]
    then, now = recorded.get(SOURCE, here[SOURCE]), here[SOURCE]
    other = () if then == now else (f"recorded with another motm_twin ({then} → {now})",)
    return (*other, *(f"{name} {there} there, {now} here" for name, there, now in pairs if there != now))
