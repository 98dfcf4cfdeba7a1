"""Edits that wait to be applied, tried on a copy of the world one after another: each is done once."""

from motm_twin.model.edits import WorldEdit
from motm_twin.sim.edit_effects import Effects
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.scenery import Scenery
from motm_twin.sim.world_edits import check_edit


class Rehearsal:
    """What the accepted edits will make of a standing world. Worthless once that world has changed or moved on."""

    def __init__(self, effects: Effects, state: PlantState, scenery: Scenery) -> None:
        """Of this state, which is copied when there is something to try on it."""
        self._effects, self._state, self._scenery = effects, state, scenery
        self._copied = False
        self._due: WorldEdit | None = None  # accepted last; the last one of all need never be tried

    def accept(self, edit: WorldEdit) -> None:
        """Take an edit after those that were accepted before; raises ValueError when the world will not take it."""
        self._catch_up()
        check_edit(self._effects.furnishings, self._state, self._scenery, edit)
        self._due = edit

    def _catch_up(self) -> None:
        if self._due is None:
            return
        if not self._copied:
            self._state, self._copied = self._state.rehearsal(), True
        edit, self._due = self._due, None
        _, self._scenery = self._effects.apply(self._state, self._scenery, edit)
