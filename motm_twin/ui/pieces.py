"""A piece of HTML in a panel that is sent only when it changes."""

import viser


class Piece:
    """Shows a text; "" hides it."""

    def __init__(self, gui: viser.GuiApi, content: str = "") -> None:
        self._handle, self._shown = gui.add_html(content, visible=bool(content)), content

    def set(self, content: str) -> None:
        """Show this; texts from outside must be escaped already."""
        if content == self._shown:
            return
        if bool(content) != bool(self._shown):
            self._handle.visible = bool(content)
        self._shown = content
        if content:
            self._handle.content = content
