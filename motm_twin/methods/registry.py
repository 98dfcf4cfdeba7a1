"""Methods by name: the shipped ones, and a user's own from a file."""

import importlib.util
import sys
from pathlib import Path

from motm_twin.control.method import Method
from motm_twin.methods.fast import FAST
from motm_twin.methods.modifications import ABLATIONS, MOTM, PAPER_LITERAL, STAA
from motm_twin.model.names import MethodError, hint
from motm_twin.rivals.holistic import HOLISTIC
from motm_twin.rivals.motm2022 import MOTM2022
from motm_twin.rivals.open_loop import OPEN_LOOP
from motm_twin.rivals.stationary import STATIONARY

METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        MOTM,
        PAPER_LITERAL,
        *ABLATIONS,
        STAA,
        MOTM2022,
        HOLISTIC,
        *STATIONARY,
        OPEN_LOOP,
        FAST,
    )
}


def find_method(name: str) -> Method:
    """The method of this name, or of ``FILE.py:NAME``, a `Method` of that name in a file of the user's.

    Raises MethodError. A file is run, with the rights of whoever named it: never a name that came over the network.
    """
    if name in METHODS:
        return METHODS[name]
    file, colon, variable = name.rpartition(":")
    if colon and file.endswith(".py"):
        return _from_file(Path(file), variable)
    raise MethodError(f"there is no method {name!r}; {hint(name, METHODS)}; or give FILE.py:NAME of your own")


def _from_file(file: Path, variable: str) -> Method:
    if not file.is_file():
        raise MethodError(f"{file}: there is no such file")
    module_name = f"motm_twin_user_{file.stem}"
    spec = importlib.util.spec_from_file_location(module_name, file.resolve())
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise MethodError(f"{file} cannot be run: {type(error).__name__}: {error}") from error
    found = getattr(module, variable, None)
    if not isinstance(found, Method):
        names = [key for key, value in vars(module).items() if isinstance(value, Method)]
        raise MethodError(f"{file} has no Method called {variable!r}; {hint(variable, names)}")
    if found.name in METHODS:
        raise MethodError(f"{file}: {variable} is named {found.name!r}, as a shipped method is: give it another name")
    return found
