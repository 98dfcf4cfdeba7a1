"""Avoidance snapshots of the real page: a served twin, stepped to four moments of the example, photographed."""

import io
from typing import Any

import numpy as np
from PIL import Image

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import STEPS, Pause, Reset, Step
from motm_twin.model.plant import PERIOD
from motm_twin.perf.page_reader import browser
from motm_twin.perf.processes import act, now, served, wait_for
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies.paper.data import command_of
from motm_twin.studies.paper.episode import Episode, Moment
from motm_twin.studies.paper.part import TWO_COLUMNS, Drawn, Missing, Part, figure, styled
from motm_twin.ui.scene.cameras import FIELD_OF_VIEW, overview

BEFORE_S = (3.0, 1.0, 0.0, -2.0)  # [s] the moments, before the one at which the arm is nearest
SIZE = (1920, 1200)  # [px] of the page
CUT = (800, 600)  # [px] of each picture, round where the robot is
ONLY_SCENE = "* { visibility: hidden !important } canvas { visibility: visible !important }"  # no panel, no notes
MIDDLE = 0.6  # [m] above the floor: half of the robot
SETTLED_MS = 4000  # [ms] of a paused twin until the picture is complete
ANSWER = 600.0  # [s] for some minutes of the run on a busy machine


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
        return Missing(reason=reason, larger=True)
    if episode.source != made_with()[SOURCE]:
        return Missing(reason=f"the trial is of another source ({episode.source}), which this page cannot serve")
    chosen = moments(episode)
    try:
        pictures = _photographs(episode, chosen)
    except (RuntimeError, TimeoutError, OSError) as error:
        return Missing(reason=f"the page could not be photographed: {error}")
    with styled():
        fig = figure(TWO_COLUMNS, 5.0 + TWO_COLUMNS * CUT[1] / CUT[0])
        axes = fig.subplots(2, 2).flat
        for panel, picture, index, letter in zip(axes, pictures, chosen, "abcd", strict=False):
            panel.imshow(picture)
            panel.set_axis_off()
            panel.set_title(f"({letter}) {episode.moments[index].time:.2f} s", loc="left", pad=2.0)
    return Drawn(
        caption=(
            f"Experiment 2, seed {episode.spec.seed}, on the served page in Chromium: grid, candidates, paths and "
            "the local plan "
            "as fading robots; panel and notes are hidden. The twin was stepped to these moments; nothing is posed."
        ),
        command=command_of(episode.spec, "serve") + " --expansions-only",
        n="one trial",
        rows=[
            {"time_s": each.time, "distance_m": each.distance, "task": each.task}
            for each in (episode.moments[k] for k in chosen)
        ],
        figure=fig,
    )


def _photographs(episode: Episode, chosen: list[int]) -> list[Any]:
    """Pictures of the scene at these periods."""
    spec = episode.spec
    options = ("--variant", str(spec.variant), "--seed", str(spec.seed), "--method", spec.method)
    with browser() as page, served(spec.scene, *options, "--expansions-only") as twin:
        _rewind(twin.client)
        _step_to(twin.client, min(chosen))  # before the page is there, which takes its share of the processors
        page.page.set_viewport_size({"width": SIZE[0], "height": SIZE[1]})
        page.load(twin.url)
        page.page.add_style_tag(content=ONLY_SCENE)
        box = page.page.locator("canvas").first.bounding_box()
        left, top = _corner(twin.client, box, [episode.moments[index] for index in chosen])
        pictures = []
        for index in chosen:
            _step_to(twin.client, index)
            page.page.mouse.move(2, 2)
            page.page.wait_for_timeout(SETTLED_MS)
            shot = page.page.screenshot(timeout=60_000)
            whole = Image.open(io.BytesIO(shot)).convert("RGB")
            pictures.append(np.asarray(whole.crop((left, top, left + CUT[0], top + CUT[1]))))
        return pictures


def _corner(client: TwinClient, box: Any, shown: list[Moment]) -> tuple[int, int]:
    """Left and top of the part of the page in the middle of which the robot is on its way, in the page's overview.

    ``box`` [px]: where the scene is on the page.
    """
    wide, high = box["width"], box["height"]
    scene = client.scene()
    assert scene is not None  # the page has drawn it
    eye, look_at = overview(scene, wide / high, below=0.0)
    forward = (look_at - eye) / np.linalg.norm(look_at - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y = np.mean([each.pose[:2] for each in shown], axis=0)
    ray = np.array([x, y, MIDDLE]) - eye
    focal = 0.5 * high / np.tan(FIELD_OF_VIEW / 2)
    across = 0.5 * wide + focal * (ray @ right) / (ray @ forward)
    down = 0.5 * high - focal * (ray @ np.cross(right, forward)) / (ray @ forward)
    left, top = (
        np.clip(middle - 0.5 * cut, 0, size - cut)
        for middle, cut, size in zip((across, down), CUT, (wide, high), strict=True)
    )
    return round(box["x"] + float(left)), round(box["y"] + float(top))


def _rewind(client: TwinClient) -> None:
    """Stop the run, and take it back to its start."""
    wait_for(lambda: client.command(Pause()).ok, ANSWER, "wheel")
    act(client, Reset())
    wait_for(lambda: now(client).index == 0, ANSWER, "start")


def _step_to(client: TwinClient, index: int) -> None:
    """Compute the periods until this one, paused there."""
    here = now(client).index
    while here < index:
        steps = min(index - here, int(STEPS.high))
        here += steps
        act(client, Step(count=steps))
        wait_for(lambda here=here: now(client).index == here, ANSWER, f"period {here}")
