"""Changes of a resolved scene by dotted names, as ``noise.lidar_range_sd`` or ``agents.temi_1.speed``.

Units are those of the resolved scene (`model.scene`): m, rad, s. Lists are entered by the name of an entry, or by ``*``
for all of them. A value has to be what a scene file could have said, and so has the whole scene afterwards.
"""

from collections.abc import Mapping
from typing import Any

import msgspec

from motm_twin.model.names import hint
from motm_twin.model.scene import Scene
from motm_twin.record.session import SessionError
from motm_twin.record.session_check import check_scene


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
    """A copy of nested frozen objects in which what is at the path is another value."""
    here, *rest = path
    if isinstance(owner, tuple):
        return _set_entries(owner, path, value, whole)
    fields = {field.name: field for field in msgspec.structs.fields(owner)} if isinstance(owner, msgspec.Struct) else {}
    if here not in fields:
        raise ValueError(f"change {whole!r}: there is no field {here!r}; {hint(here, fields)}")
    if rest:
        return msgspec.structs.replace(owner, **{here: _set(getattr(owner, here), rest, value, whole)})
    try:
        # through JSON's types: what a stored line says is what a caller may say
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
