"""Where bodies will be once the posted edits are applied: what a paused twin shows while somebody drags."""

from collections.abc import Sequence

import msgspec

from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.edits import AddObstacle, Edit, MoveBody, RemoveBody
from motm_twin.model.scene import Scene


def preview(scene: Scene, message: TickMessage, edits: Sequence[Edit]) -> TickMessage:
    """The last message with the edits applied to agents and added obstacles."""
    agents = {body.name: body for body in message.agents}
    obstacles = {body.name: body for body in message.obstacles}
    for edit in edits:
        match edit:
            case AddObstacle():
                obstacles[edit.name] = BodyMessage(
                    name=edit.name,
                    kind=edit.shape,
                    position=[edit.x, edit.y, 0.0],
                    yaw=edit.heading,
                    state="",
                    size=list(edit.size),
                )
            case MoveBody():
                bodies = agents if edit.name in agents else obstacles
                if edit.name in bodies:
                    bodies[edit.name] = _moved(bodies[edit.name], edit)
            case RemoveBody():
                obstacles.pop(edit.name, None)
    return msgspec.structs.replace(
        message, agents=list(agents.values()), obstacles=list(obstacles.values()), preview=bool(edits)
    )


def _moved(body: BodyMessage, edit: MoveBody) -> BodyMessage:
    yaw = body.yaw if edit.heading is None else edit.heading
    return msgspec.structs.replace(body, position=[edit.x, edit.y, body.position[2]], yaw=yaw, state="held")
