"""What the last bits of a run depend on besides the session: versions of the numeric libraries, and the machine."""

import functools
import platform
from importlib import metadata

import numpy as np

PACKAGES = (
    "motm-twin", "numpy", "scipy", "numba", "llvmlite", "pin", "coal", "shapely", "daqp", "osqp", "qpsolvers",
)  # fmt: skip


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
    return found


def made_with() -> dict[str, str]:
    """Name to version of everything here that can change the last bit of a number."""
    return dict(_versions())


def _processor() -> str:
    """The vector instructions that numpy found: with others it adds in another order."""
    found = np.show_config(mode="dicts")["SIMD Extensions"]  # type: ignore[index] - a dict in this mode
    return " ".join([*found.get("baseline", []), *found.get("found", [])])


def differences(recorded: dict[str, str]) -> tuple[str, ...]:
    """One phrase for each thing that is not here as it was there: "numpy 2.3.0 there, 2.4.6 here"."""
    here = made_with()
    names = [*here, *(name for name in recorded if name not in here)]
    pairs = [(name, recorded.get(name, "nothing"), here.get(name, "nothing")) for name in names]
    return tuple(f"{name} {there} there, {now} here" for name, there, now in pairs if there != now)
