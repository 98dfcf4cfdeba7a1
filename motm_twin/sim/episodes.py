"""Contacts that go on, one for each thing that is touched, and what is told of them."""

from dataclasses import dataclass

from motm_twin.model.plant import Contact

EPISODE_END = 0.1  # [s] apart after which a contact episode has ended


@dataclass
class Episode:
    """A contact with one thing that goes on."""

    began: float
    last: float
    bodies: tuple[str, ...]  # that touch it, in order
    closing_speed: float
    other_speed: float
    by_person: bool
    was_excused: bool  # it has been a person's doing
    excused_from: float  # [s] when it became that
    gone_on: float = 0.0  # [m] that the robot went on into what was no longer a person's doing
    depth: float = 0.0
    caused: bool = False

    def touched(self, body: str, now: float, depth: float) -> None:
        """A body touches the thing now [s], to a depth [m]."""
        if body not in self.bodies:
            self.bodies = (*self.bodies, body)
        self.last = now
        self.depth = max(self.depth, depth)


def contact_of(other: str, episode: Episode) -> Contact:
    """The contact of the robot with something else as far as it has gone: one verdict for the whole episode."""
    return Contact(
        time=episode.began,
        body=episode.bodies[0],
        other=other,
        depth=episode.depth,
        closing_speed=episode.closing_speed,
        other_speed=episode.other_speed,
        caused_by_robot=episode.caused,
        duration=episode.last - episode.began,
        bodies=episode.bodies,
    )


def take_ended(episodes: dict[str, Episode], now: float) -> list[Contact]:
    """Those that have ended, taken out."""
    ended = [other for other, episode in episodes.items() if now - episode.last > EPISODE_END]
    return [contact_of(other, episodes.pop(other)) for other in ended]
