"""How well it goes: time, picks, places, contacts, clearances, distance, beside what has been published."""

from motm_twin.bus.messages import ScoreMessage, StatusMessage, TickMessage
from motm_twin.control.task_list import kind_of, name_of
from motm_twin.measures.published import REFERENCE_TOUR_NOTE, published
from motm_twin.model.scene import Scene
from motm_twin.ui.markup import GREEN, RED, card, heading, metres, table, text


def score_card(tick: TickMessage, status: StatusMessage | None, scene: Scene | None = None) -> str:
    """The referee's count up to the shown period, and the published times of this task."""
    rows: list[tuple[str, ...]] = [("time", f"<b>{_time(tick):.2f} s</b>")]
    score = tick.score
    if score is not None:
        rows += _count(tick, score)
    return card(heading("Score"), *_compared(rows, tick, status, scene))


def result_card(tick: TickMessage, status: StatusMessage | None, scene: Scene | None = None) -> str:
    """What a finished run has come to, in short; "" before its end."""
    if not tick.done:
        return ""
    rows: list[tuple[str, ...]] = [("time of this run", f"<b>{_time(tick):.2f} s</b>")]
    if tick.score is not None:
        rows.append(("distance driven", f"{tick.score.path_length:.1f} m"))
        rows.append(("least clearance, base", metres(tick.score.min_base_clearance)))
    return card(heading("Result"), *_compared(rows, tick, status, scene))


def _time(tick: TickMessage) -> float:
    """[s] of the work: a finished run goes on for 2 s, so that the robot comes to rest."""
    return tick.time if tick.ended is None else tick.ended


def _compared(
    rows: list[tuple[str, ...]], tick: TickMessage, status: StatusMessage | None, scene: Scene | None
) -> tuple[str, str]:
    """The rows and what they are beside, which are times of the tasks of the scene, in any order: of no others."""
    if scene is not None and sorted((task.kind, task.target) for task in tick.tasks) != _tasks(scene):
        return table(rows), '<hr><div class="mu">the task list was changed: no time to compare with</div>'
    return table(rows + _tour(tick, status)), _published(tick, status)


def _tasks(scene: Scene) -> list[tuple[str, str]]:
    return sorted((kind_of(task), name_of(task)) for task in scene.tasks)


def _count(tick: TickMessage, score: ScoreMessage) -> list[tuple[str, ...]]:
    picks = sum(task.kind == "pick" for task in tick.tasks)
    places = sum(task.kind == "place" for task in tick.tasks)
    ours = sum(contact.caused_by_robot for contact in score.contacts)
    others = len(score.contacts) - ours
    rows: list[tuple[str, ...]] = [
        ("picked", f"{score.picks} of {picks}"),
        ("placed", f"{score.places} of {places}"),
        (
            "contacts of the robot",
            f'<b style="color:{RED if ours else GREEN}">{ours}</b>' + (f", {others} by others" if others else ""),
        ),
    ]
    if score.drops:
        rows.append(("dropped", str(score.drops) + (f", {len(score.dropped)} not put right" if score.dropped else "")))
    if score.cut_ins:
        rows.append(("cut in on agents", str(len(score.cut_ins))))
    return [
        *rows,
        ("least clearance, base", metres(score.min_base_clearance)),
        ("least clearance, arm", metres(score.min_arm_clearance)),
        ("least, gripper to others", metres(score.min_ee_obstacle)),
        ("distance driven", f"{score.path_length:.1f} m"),
    ]


def _tour(tick: TickMessage, status: StatusMessage | None) -> list[tuple[str, ...]]:
    tour = None if status is None else status.reference_tour
    if tour is None or tour <= 0.0:
        return []
    name = f'<span title="{text(REFERENCE_TOUR_NOTE)}" style="border-bottom:1px dotted">reference tour</span>'
    ratio = f"{_time(tick) / tour:.2f}" if tick.done else f"{tick.time / tour:.2f} so far"
    return [(name, f"{tour:.1f} s"), ("time / reference tour", ratio)]


def _published(tick: TickMessage, status: StatusMessage | None) -> str:
    known = () if status is None else published(status.scene, status.variant)
    if not known:
        return '<hr><div class="mu">no published time for this task</div>'
    rows: list[tuple[str, ...]] = []
    for entry in known:
        name = f'<span class="mu" title="{text(entry.source)}">{text(entry.what)}</span>'
        success = f" ({entry.success})" if entry.success else ""
        against = ""
        if tick.done and tick.success:
            share = 100.0 * (_time(tick) / entry.seconds - 1.0)
            against = f' <span style="color:{GREEN if share <= 0.0 else RED}">{share:+.0f} %</span>'
        rows.append((name, f"{entry.seconds:.1f} s{success}{against}"))
    sources = ", ".join(dict.fromkeys(entry.source.split(",")[0] + "," + entry.source.split(",")[1] for entry in known))
    return f'<hr>{table(rows)}<div class="mu" style="font-size:11px">{text(sources)}</div>'
