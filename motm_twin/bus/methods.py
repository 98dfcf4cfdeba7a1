"""The methods that a server offers: the shipped ones, and one of a file that it was started with.

No command names a file.
"""

from typing import TYPE_CHECKING

from motm_twin.bus.messages import MethodChoice
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.names import hint

if TYPE_CHECKING:
    from motm_twin.control.method import Method


class MethodLibrary:
    """Methods by name. They import control and planning, which is slow, so only once somebody asks."""

    def __init__(self, own: str = DEFAULT_METHOD) -> None:
        """``own``: a shipped name, or FILE.py:NAME from the command line, whose file is run now. Raises MethodError."""
        self._found: dict[str, Method] = {}
        self.own_name = own  # of the method that the server begins with
        if ":" in own:
            self._add_file(own)

    def choices(self) -> list[MethodChoice]:
        """What can be loaded."""
        return [
            MethodChoice(
                name=method.name, title=method.title, summary=method.summary, parameters=dict(method.parameters)
            )
            for method in self._known().values()
        ]

    def find(self, name: str) -> "Method":
        """A method by its name, and by nothing else. Raises MethodError with the near ones."""
        from motm_twin.model.names import MethodError

        known = self._known()
        if name not in known:
            raise MethodError(f"no method is called {name[:64]!r}; {hint(name, known)}")
        return known[name]

    def _known(self) -> "dict[str, Method]":
        from motm_twin.methods.registry import METHODS

        return {**METHODS, **self._found}

    def _add_file(self, own: str) -> None:
        from motm_twin.methods.registry import find_method

        method = find_method(own)
        self._found[method.name] = method
        self.own_name = method.name
