"""The occupancy grid as a soft ground: clear where it is free, green to red towards obstacles."""

import numpy as np
import viser

from motm_twin.bus.client import Grid
from motm_twin.ui.colours import ground_table

NAME = "/map"
HEIGHT = 0.002  # [m] above the floor


class MapView:
    """One image, replaced when a new grid has arrived."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server, self._table = server, ground_table()
        self._shown: Grid | None = None
        self._handle: viser.ImageHandle | None = None
        self._key: tuple = ()
        self.on = True

    def update(self, grid: Grid | None) -> None:
        """Show this grid."""
        if self._handle is not None and self._handle.visible != self.on:
            self._handle.visible = self.on
        if grid is None or grid is self._shown:
            return
        self._shown = grid
        info = grid.info
        picture = self._table[grid.cells]
        key = (info.width, info.height, info.resolution, tuple(info.origin))
        if self._handle is not None and key == self._key:
            self._handle.image = picture
            return
        self._key = key
        width, height = info.width * info.resolution, info.height * info.resolution
        self._handle = self._server.scene.add_image(
            NAME,
            picture,
            width,
            height,
            format="png",
            position=(info.origin[0] + width / 2, info.origin[1] + height / 2, HEIGHT),
            cast_shadow=False,
            receive_shadow=False,
            visible=self.on,
        )

    @property
    def cells(self) -> np.ndarray | None:
        """What is shown, for tests."""
        return None if self._shown is None else self._shown.cells
