"""Contacts that go on, and what is told of them."""

from dataclasses import dataclass

from motm_twin.model.plant import Contact


@dataclass
class Episode:
    """A contact that goes on."""

    began: float
    last: float
    depth: float
    closing_speed: float
    other_speed: float
    robot_moved: bool
    by_person: bool


def contact_of(pair: tuple[str, str], episode: Episode) -> Contact:
    """What a contact of a part of the robot with something else has been so far."""
    return Contact(
        time=episode.began,
        body=pair[0],
        other=pair[1],
        depth=episode.depth,
        closing_speed=episode.closing_speed,
        other_speed=episode.other_speed,
        caused_by_robot=episode.robot_moved,
        duration=episode.last - episode.began,
    )
