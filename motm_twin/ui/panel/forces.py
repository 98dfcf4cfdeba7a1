"""The card of the Why tab with forces, under contact dynamics: grasp, external torque, phantom collisions, wrist."""

from motm_twin.bus.messages import ForcesMessage, GraspMessage, TickMessage
from motm_twin.model.physics import REFLEXES
from motm_twin.ui.panel.widgets import AMBER, GREEN, RED, bar, card, chip, explained, heading, mark, pairs, piece, text

NOMINAL, ACCELERATING = REFLEXES.values()
TOP = 1.5 * ACCELERATING  # [Nm] at the end of the bar
_TORQUE = (
    "Torque that the arm takes for a push from outside: it does not know that its base accelerates or rolls over a "
    "bump. From the marks on the Panda stops by itself."
)
_PHANTOM = "Times that such a threshold was passed although the robot touched nothing."
_WRIST = "What a sensor at the hand's mount would read, the weight of the hand included."


def forces_card(tick: TickMessage) -> str:
    """Forces of now and the newest grasp; "" without contact dynamics."""
    felt = tick.forces
    if felt is None:
        return ""
    (left, right), (first, second) = felt.fingers, felt.phantoms
    wrist = f"{felt.wrist[0]:.1f} N, at most {felt.wrist_peaks[0]:.0f} N"
    rows = [
        ("fingers, left and right", f"<b>{left:.0f} N, {right:.0f} N</b>"),
        *([] if felt.grasp is None else _grasp(felt.grasp)),
        (explained("force at the wrist", _WRIST), wrist),
        (explained("phantom collisions", _PHANTOM), f"{first} over {NOMINAL:g} Nm, {second} over {ACCELERATING:g} Nm"),
    ]
    return card(heading("Forces"), _torque(felt), pairs(rows))


def _torque(felt: ForcesMessage) -> str:
    """The joint that feels most, on a bar with the thresholds."""
    sizes = [abs(value) for value in felt.external_torque]
    most = max(sizes)
    colour = RED if most > ACCELERATING else AMBER if most > NOMINAL else GREEN
    now = chip(f"joint {sizes.index(most) + 1}: {most:.1f} Nm", colour)
    row = explained("external torque", _TORQUE), f"{now} at most {max(felt.torque_peaks, default=most):.0f} Nm"
    marks = (mark(NOMINAL / TOP), mark(ACCELERATING / TOP))
    return f"{pairs([row])}{bar(piece(0.0, min(most / TOP, 1.0), colour), *marks, height=6)}"


def _grasp(grasp: GraspMessage) -> list[tuple[str, str]]:
    name = text(grasp.object)
    slip = f"slipped {1e3 * grasp.slip:.1f} mm" + (", <b>lost</b>" if grasp.lost else "")
    return [
        (f"grasp of {name}", f"firm after {grasp.firm:.2f} s, hand at most {1e3 * grasp.speed:.0f} mm/s"),
        ("the fingers shifted it by", f"{1e3 * grasp.shift:.1f} mm; {slip}"),
    ]
