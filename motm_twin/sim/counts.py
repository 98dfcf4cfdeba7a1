"""What counts of the objects: picked, placed, dropped, and put right again."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from motm_twin.sim.objects import ObjectState

LIFTED = 0.02  # [m] above where it was taken: the cube counts as picked
DROP_HEIGHT = 0.01  # [m] of fall that makes a drop


@dataclass
class Counts:
    """What was picked, placed and dropped so far, and what the next step of an object will mean."""

    right_bins: dict[str, tuple[str, ...]] = field(default_factory=dict)  # where each object belongs
    disturbed: tuple[str, ...] = ()  # objects that lie or fall where they do by a person's doing: no place, no drop
    held: str = ""
    held_from_z: float = 0.0
    picked: bool = False  # the held cube has been counted
    falling_from: dict[str, float] = field(default_factory=dict)
    inside: tuple[str, ...] = ()  # objects counted as placed, until they are picked again
    placed: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()  # and not picked up and placed since
    picks: int = 0
    drops: int = 0

    def step(self, objects: Sequence[ObjectState], held: str) -> bool:
        """Count what a substep brought; whether another object, or none, is held now."""
        for item in objects:
            if item.state == "falling":
                self.falling_from.setdefault(item.name, item.bottom)
            else:
                self._settled(item)
        if not held and not self.held:
            return False
        item = next((item for item in objects if item.name == held), None)
        if held != self.held:
            self.held, self.picked = held, False
            self.held_from_z = float(item.position[2]) if item is not None else 0.0
            return True
        if item is not None and not self.picked and item.position[2] > self.held_from_z + LIFTED:
            self.picked = True
            self.picks += 1
            self.inside = tuple(name for name in self.inside if name != held)
            if held not in self.right_bins:  # nowhere to be placed: in the hand again is all there is
                self._put_right(held)
        return False

    def _settled(self, item: ObjectState) -> None:
        """An object does not fall, or no longer."""
        fell_from = self.falling_from.pop(item.name, None)
        binned = item.state.startswith("binned:")
        if item.name in self.disturbed:
            if not binned:
                self.disturbed = tuple(name for name in self.disturbed if name != item.name)
        elif binned:
            bin_name = item.state.removeprefix("binned:")
            if item.name not in self.inside and bin_name in self.right_bins.get(item.name, ()):
                self.inside, self.placed = (*self.inside, item.name), (*self.placed, item.name)
                self._put_right(item.name)
        elif fell_from is not None and item.state != "held" and fell_from - item.bottom > DROP_HEIGHT:
            self.drops += 1
            self._put_right(item.name)
            self.dropped = (*self.dropped, item.name)
            self.inside = tuple(name for name in self.inside if name != item.name)

    def _put_right(self, item: str) -> None:
        self.dropped = tuple(name for name in self.dropped if name != item)
