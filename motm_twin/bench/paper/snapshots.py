"""Avoidance snapshots of the real page: a served twin, stepped to four moments of the example, photographed."""

import io
from typing import Any

import numpy as np
from PIL import Image

from motm_twin.bench.page_browser import VIEW, browser
from motm_twin.bench.page_serve import served, wait_for
from motm_twin.bench.paper.episode import Episode, Moment
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.style import TWO_COLUMNS, figure, styled
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import HandOver, Pause, Reset, Step

NAME, TITLE = "snapshots", "Arm and base avoid a Temi: the page at four moments"
COMMAND = "motm-twin paper --only snapshots"
BEFORE_S = (3.0, 1.0, 0.0, -2.0)  # [s] the moments, before the one at which the arm is nearest
SCENE = 0.60  # of the picture's width: the panel lies on the rest
SETTLED_MS = 2500  # [ms] of a paused twin until the picture is complete
ANSWER = 120.0  # [s]
PERIOD = 0.05  # [s]


def moments(episode: Episode) -> list[int]:
    """Periods to photograph: round the one in which the gripper is nearest to something that moves, and carries."""
    near = [_nearness(each) for each in episode.moments]
    middle = int(np.argmin(near))
    last = len(episode.moments) - 1
    return sorted({min(last, max(1, middle - round(before / PERIOD))) for before in BEFORE_S})


def _nearness(moment: Moment) -> float:
    if moment.distance is None or moment.static or not moment.task.startswith("place"):
        return np.inf
    return moment.distance


def draw(episode: Episode) -> Part:
    """Four photographs beside each other; the reason where there can be none."""
    if not np.isfinite(min(_nearness(each) for each in episode.moments)):
        reason = f"in the example trial (seed {episode.spec.seed}) no Temi came near the gripper with an object in it"
        return Missing(name=NAME, title=TITLE, reason=reason, command=COMMAND)
    chosen = moments(episode)
    try:
        pictures = _photographs(episode, chosen)
    except (RuntimeError, TimeoutError, OSError) as error:
        return Missing(name=NAME, title=TITLE, reason=f"the page could not be photographed: {error}", command=COMMAND)
    with styled():
        fig = figure(TWO_COLUMNS, 5.0 + TWO_COLUMNS * VIEW["height"] / (VIEW["width"] * SCENE))
        axes = fig.subplots(2, 2).flat
        for panel, picture, index, letter in zip(axes, pictures, chosen, "abcd", strict=False):
            panel.imshow(picture)
            panel.set_axis_off()
            panel.set_title(f"({letter}) {episode.moments[index].time:.2f} s", loc="left", pad=2.0)
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            f"Experiment 2, seed {episode.spec.seed}, on the served page in Chromium: grid, candidates, paths and "
            "the local plan "
            "as fading robots. The twin was stepped to these moments; nothing is posed."
        ),
        command=f"{COMMAND} (or motm-twin serve exp2 --seed {episode.spec.seed})",
        n="one trial",
        rows=[
            {
                "time_s": episode.moments[k].time,
                "distance_m": episode.moments[k].distance,
                "task": episode.moments[k].task,
            }
            for k in chosen
        ],
        figure=fig,
    )


def _photographs(episode: Episode, chosen: list[int]) -> list[Any]:
    """Pictures of the scene at these periods."""
    spec = episode.spec
    with browser() as page, served(spec.scene, "--variant", str(spec.variant), "--seed", str(spec.seed)) as twin:
        _to(twin.client, 1)
        page.load(twin.url)
        note = page.page.get_by_role("button", name="Got it", exact=True).locator("visible=true")
        if note.count():
            note.first.click()
        pictures = []
        for index in chosen:
            _to(twin.client, index)
            page.page.mouse.move(2, 2)
            page.page.wait_for_timeout(SETTLED_MS)
            shot = page.page.screenshot(timeout=60_000)
            whole = Image.open(io.BytesIO(shot)).convert("RGB")
            pictures.append(np.asarray(whole.crop((0, 0, round(SCENE * whole.width), whole.height))))
        return pictures


def _to(client: TwinClient, index: int) -> None:
    """The run from its start to a period, paused there; the wheel is free afterwards."""
    wait_for(lambda: client.command(Pause()).ok, ANSWER, "wheel")
    client.command(Reset())
    wait_for(lambda: _at(client, 0), ANSWER, "start")
    client.command(Step(count=index))
    wait_for(lambda: _at(client, index), ANSWER, f"period {index}")
    client.command(HandOver())


def _at(client: TwinClient, index: int) -> bool:
    tick = client.tick()
    return tick is not None and tick.index == index
