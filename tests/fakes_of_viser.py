"""Handles that remember what is set on them, in place of those of viser."""

from types import SimpleNamespace
from typing import Any


class Scene:
    """What was added to a scene, by name."""

    def __init__(self) -> None:
        self.handles: dict[str, SimpleNamespace] = {}
        self.server: Any = SimpleNamespace(scene=self)

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("add_"):
            raise AttributeError(name)

        def add(name: str, *given: Any, visible: bool = True, **options: Any) -> SimpleNamespace:
            return self.handles.setdefault(name, SimpleNamespace(visible=visible))

        return add
