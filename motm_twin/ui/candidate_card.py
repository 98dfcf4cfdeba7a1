"""The places where the base could stand: the costs of the one that was clicked, or what the colours mean."""

import math
from collections import Counter

from motm_twin.bus.messages import PlacementMessage
from motm_twin.ui import colours
from motm_twin.ui.markup import MUTED, Piece, bar, card, heading, pairs, seconds, sentence, text

NEXT_WEIGHT = "next_weight"  # parameter: weight of the cost C_N
ROUNDED = 0.05  # [s] by which the costs of a message may be off their sum


def candidate_card(placement: PlacementMessage, index: int | None, next_weight: float = 1.05) -> str:
    """Costs of one candidate, or why it is out; of the chosen one, with the legend, when none is picked."""
    if index is None or not 0 <= index < len(placement.poses):
        return _chosen(placement, next_weight) + _hint(placement)
    x, y, heading_ = placement.poses[index]
    rows = [
        heading(_title(placement, index)),
        f'<div class="mu">x {x:.2f} m, y {y:.2f} m, heading {math.degrees(heading_):.0f}&deg;</div>',
    ]
    if placement.rejected[index]:
        rows.append(sentence(f"rejected: {placement.rejected[index]}", MUTED))
    else:
        rows += _costs(placement, index, next_weight)
    return card(*rows)


def _chosen(placement: PlacementMessage, weight: float) -> str:
    index = placement.chosen
    if not 0 <= index < len(placement.poses):
        return ""
    return card(heading(_title(placement, index)), *_costs(placement, index, weight))


def _title(placement: PlacementMessage, index: int) -> str:
    """Its number is no rank: candidates are numbered round the target."""
    place = "" if placement.cost[index] is None else f", rank {rank(placement, index)}"
    chosen = ", <b>chosen</b>" if index == placement.chosen else ""
    return f"Candidate no. {index + 1} (of {len(placement.poses)}){place}{chosen}"


def _costs(placement: PlacementMessage, index: int, weight: float) -> list[str]:
    here, onward, total = (cost[index] for cost in (placement.cost_current, placement.cost_next, placement.cost))
    viable = sum(cost is not None for cost in placement.cost)
    paper = here is None or onward is None or total is None or abs(here + weight * onward - total) < ROUNDED
    rule = f"cost C = C<sub>C</sub> + {weight:g} C<sub>N</sub>" if paper else "cost C by the rule of this method"
    rows = [
        ("current cost C<sub>C</sub>: to it", seconds(here)),
        ("next cost C<sub>N</sub>: on to the next target", seconds(onward)),
        (rule, f"<b>{seconds(total)}</b>"),
        ("rank by C among the free", f"{rank(placement, index)} of {viable}{_dearer(placement, index)}"),
    ]
    if not paper:
        return [pairs(rows)]
    pieces = []
    dearest = max((cost for cost in placement.cost if cost is not None), default=0.0)
    if here is not None and dearest > 0.0:
        pieces.append(Piece(0.0, here / dearest, colours.css(colours.INSPECTED)))
        if onward is not None:
            pieces.append(
                Piece(here / dearest, (here + weight * onward) / dearest, colours.css(colours.INSPECTED_NEXT))
            )
    return [pairs(rows), f'<div style="margin-top:4px">{bar(*pieces, height=7)}</div>']


def _dearer(placement: PlacementMessage, index: int) -> str:
    own, chosen = placement.cost[index], placement.chosen
    best = placement.cost[chosen] if 0 <= chosen < len(placement.cost) else None
    if own is None or best is None or index == chosen:
        return ""
    return f"<br>{own - best:+.1f} s against the chosen"


def rank(placement: PlacementMessage, index: int) -> int:
    """1 for the cheapest candidate."""
    own = placement.cost[index]
    return 1 + sum(cost is not None and own is not None and cost < own for cost in placement.cost)


def _hint(placement: PlacementMessage) -> str:
    """What can be clicked, and why the grey ones are out."""
    count = len(placement.poses)
    if not count:
        return legend(placement)
    reasons = Counter(why for why in placement.rejected if why)
    out = sum(reasons.values())
    rows = [f"<div><b>Click one of the coloured places</b> to read its costs. {count - out} of {count} are free</div>"]
    if out:
        most = ", ".join(f"{number} {text(why)}" for why, number in reasons.most_common(3))
        rows.append(f'<div class="mu">out: {most}</div>')
    return card(heading("Places to stand"), *rows) + legend(placement)


def legend(placement: PlacementMessage | None = None) -> str:
    """What the colours mean."""
    known = [cost for cost in (placement.cost if placement else []) if cost is not None]
    low, high = (f"{min(known):.1f} s", f"{max(known):.1f} s") if known else ("cheap", "dear")
    lines = [
        (colours.GLOBAL_PATH, "global path"),
        (colours.NEXT_PATH, "on to the next target"),
        (colours.BEZIER, "B&eacute;zier"),
        (colours.GHOST, "local plan"),
    ]
    marks = "".join(
        f'<span style="white-space:nowrap;margin-right:10px"><span style="display:inline-block;width:14px;height:4px;'
        f'border-radius:2px;vertical-align:middle;background:{colours.css(colour)}"></span> {name}</span>'
        for colour, name in lines
    )
    return card(
        '<div style="display:flex;align-items:center;gap:6px">'
        f'<span style="white-space:nowrap">{low}</span><span style="flex:1;height:8px;border-radius:4px;background:'
        f'{colours.viridis_css()}"></span><span style="white-space:nowrap">{high}</span></div>'
        f'<div class="mu" style="margin-top:3px">{marks}<span style="white-space:nowrap">'
        f'<span style="display:inline-block;width:8px;height:8px;border-radius:4px;background:'
        f'{colours.css(colours.REJECTED)}"></span> rejected</span></div>'
    )
