"""The pictures of README and docs: what each shows, and how a person gets there."""

from page import Visitor, until
from states import State, at

from motm_twin.bus.commands import HandOver, Pause, Play, Reset, Speed
from motm_twin.ui.scene.picking import CANDIDATE_HEIGHT

SIZE = (1280, 800)  # [px]
GRAB = 0.15  # [m] height at which a Temi is taken
COMPARED = 600.0  # [s] for both runs of a comparison, on a machine that may be busy


def play_to(person: Visitor, seconds: float) -> None:
    """The run from its start to a simulated time, paused there; then the wheel is free."""
    client = person.twin.client
    until(lambda: client.command(Pause()).ok, 60.0, "the wheel is not free")
    client.command(Reset())
    until(lambda: client.tick().index == 0, 60.0, "not at the start")
    client.command(Speed(factor=2.0))
    client.command(Play())
    until(lambda: client.tick().time >= seconds, 20.0 + 4.0 * seconds, f"not at {seconds:.0f} s")
    client.command(Pause())
    client.command(Speed(factor=1.0))
    client.command(HandOver())
    until(lambda: client.status().state == "paused" and not client.status().driver, 60.0, "not paused")


def page(person: Visitor) -> None:
    """The robot at work among Temis."""
    play_to(person, 15.0)
    person.tab("Drive")
    person.settled()
    person.press("Play")
    person.state("Running")
    until(lambda: person.twin.client.tick().time >= 16.0, 60.0, "it stands")


def disturb(person: Visitor) -> None:
    """A Temi is dragged into the way."""
    play_to(person, 1.0)
    person.tab("Disturb")
    person.press("Temi")
    client = person.twin.client
    temi = until(lambda: client.tick().obstacles, 60.0, "no Temi")[0]
    person.settled()
    path = client.tick().plan.global_path
    x, y = path[min(1, len(path) - 1)]
    robot = client.tick().robot.pose
    person.drag([*temi.position[:2], GRAB], [(2 * x + robot[0]) / 3, (2 * y + robot[1]) / 3, GRAB])
    person.settled()


def why(person: Visitor) -> None:
    """A candidate is clicked: its costs and its paths."""
    at(person, 1)
    person.tab("Why")
    person.settled()
    placement = person.twin.client.tick().placement
    person.click((*placement.poses[placement.chosen][:2], CANDIDATE_HEIGHT))
    until(lambda: person.twin.client.tick().inspected, 60.0, "no paths")


def tune(person: Visitor) -> None:
    """Both robots of a comparison."""
    play_to(person, 12.0)
    person.tab("Tune")
    person.page.get_by_label("Try in what-if only", exact=True).click()
    person.choose("Preset", "STAA*")
    person.press("Compare")
    until(lambda: person.sees("faster") or person.sees("slower") or person.sees("as fast"), COMPARED, "no result")


def replay(person: Visitor) -> None:
    """Looking back."""
    play_to(person, 14.0)
    person.tab("Replay")
    for _ in range(40):
        person.press("Back by one period")
    person.says("Looking back")


_EXP1, _EXP2 = ("exp1", "--variant", "trial1"), ("exp2", "--variant", "random", "--seed", "0")
PICTURES = {
    "page": State(_EXP2, page),
    "page_replay": State(_EXP2, replay),
    "page_why": State(_EXP1, why),
    "page_disturb": State(_EXP1, disturb),
    "page_tune": State(("exp1", "--variant", "trial2"), tune),
}
