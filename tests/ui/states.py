"""The main states of the page, of which reference pictures are kept; each is reached the same way every time."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from page import Visitor, until
from PIL import Image

from motm_twin.bus.commands import HandOver, Pause, Reset, Step
from motm_twin.ui.scene.picking import CANDIDATE_HEIGHT

FOLDER = Path(__file__).parent / "pictures"
SIZE = (960, 600)  # [px]
REDUCED = (240, 150)  # [px] at which pictures are compared: letters and edges are smoothed away
PANEL = 630  # [px] where the panel begins
CLEAR = 40.0  # [grey levels] of difference that anybody sees
MEAN, SHARE = 4.0, 0.03  # [grey levels] on average, and share of clear pixels, that whole and scene may differ by
START, DRIVEN, BACK = 1, 40, 4  # periods


@dataclass(frozen=True)
class State:
    """What is served, and how the page gets there."""

    scene: tuple[str, ...]
    show: Callable[[Visitor], None]


def visitor(browser, twin, size=SIZE):
    """Somebody with a page of this size; the twin is paused."""
    person = Visitor.enter(browser, twin, {"width": size[0], "height": size[1]}, fine=True)
    at(person, START)
    return person


def at(person, index):
    """The run from its start to a period, and no further; then the wheel is free."""
    client = person.twin.client
    until(lambda: client.command(Pause()).ok, 60.0, "the wheel is not free")
    client.command(Reset())
    until(lambda: client.tick().index == 0 and client.status().state == "paused", 60.0, "not at the start")
    client.command(Step(count=index))
    until(lambda: client.tick().index == index, 60.0, f"not at period {index}")
    client.command(HandOver())
    until(lambda: client.status().driver == "", 60.0, "the wheel is not free")


def screenshot(person):
    """The whole page; of a paused twin once nothing changes any more."""
    person.close_notes()
    person.page.mouse.move(2, 2)
    paused = person.twin.client.status().state == "paused"
    shown = person.settled(quiet=1, look=person.shot) if paused else person.shot()
    return Image.fromarray(shown.astype(np.uint8))


def difference(picture, reference):
    """For two pictures and their scenes: mean difference [grey levels] and share of clearly different pixels."""
    first, second = (
        np.asarray(each.resize(REDUCED, Image.Resampling.BOX), dtype=float) for each in (picture, reference)
    )
    apart = np.abs(first - second)
    edge = PANEL * REDUCED[0] // SIZE[0]
    parts = {"whole": apart, "scene": apart[:, :edge]}
    return {name: (float(part.mean()), float((part.max(axis=2) > CLEAR).mean())) for name, part in parts.items()}


def alike(difference):
    """True when a difference is small enough to be rendering noise."""
    return all(mean < MEAN and share < SHARE for mean, share in difference.values())


def overview(person):
    at(person, START)
    person.tab("Drive")


def running(person):
    at(person, DRIVEN)
    person.tab("Drive")


def candidate(person):
    at(person, START)
    person.tab("Why")
    placement = person.twin.client.tick().placement
    person.click((*placement.poses[placement.chosen][:2], CANDIDATE_HEIGHT))
    until(lambda: person.twin.client.tick().inspected, 60.0, "no paths of the candidate")
    person.says(", chosen")


def tune(person):
    person.tab("Tune")


def looking_back(person):
    at(person, DRIVEN)
    person.tab("Replay")
    for back in range(1, BACK + 1):
        person.press("Back by one period")
        person.says(f"period {DRIVEN - back}")


_EXP1, _EXP2 = ("exp1", "--variant", "trial1"), ("exp2", "--variant", "trial1")
STATES = {
    "overview": State(_EXP1, overview),
    "candidate": State(_EXP1, candidate),
    "tune": State(_EXP1, tune),
    "running": State(_EXP2, running),
    "looking_back": State(_EXP2, looking_back),
}
