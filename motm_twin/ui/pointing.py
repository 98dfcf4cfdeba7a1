"""What a click in the scene means.

Candidate: its costs and paths. Body, furniture, bin, cube: it is selected, or let go when it is; but a cube stays
picked up, for a bin after a cube means that it is to be delivered there. Floor: a body that was just added is
put there, an agent is sent there, what is selected is let go, or else the robot drives there now. Any click takes a
wheel that is free.
"""

import asyncio

import viser

from motm_twin.bus.commands import Command
from motm_twin.bus.messages import TickMessage
from motm_twin.model.edits import InsertTask, MoveBody, RemoveTask, SendAgent
from motm_twin.model.scene import DriveTo, Pick, Place
from motm_twin.ui.aim import Hit, Ray, Surroundings
from motm_twin.ui.drag import Drag
from motm_twin.ui.hub import Hub, Visitor
from motm_twin.ui.task_list import waiting_job

SELECTED = ("object", "bin", "body", "piece")


class Pointing:
    """Turns clicks into choices and commands. An orbit drag is no click: the page tells them apart by motion."""

    def __init__(self, server: viser.ViserServer, hub: Hub, drag: Drag) -> None:
        self._hub, self._drag = hub, drag
        self.surroundings: Surroundings | None = None
        self.tick: TickMessage | None = None
        server.scene.on_click()(hub.watching(self._click))

    async def _click(self, event: viser.SceneClickEvent, visitor: Visitor) -> None:
        if self.surroundings is None or self.tick is None:
            return
        hub, view, tick = self._hub, self._hub.view, self.tick
        if not hub.drives(visitor):
            hub.tell(visitor, self._drag.refusal(visitor), "Only looking")
            return
        hub.keep_wheel(visitor)
        ray = Ray.through(event.ray_origin, [o + d for o, d in zip(event.ray_origin, event.ray_direction, strict=True)])
        aiming = bool(view.sending or view.placing)  # at the floor: dots that lie there are not meant
        hit = self.surroundings.first(ray, tick, candidates=view.layers["Candidates"] and not aiming)
        if hit is None or hit.kind != "floor":
            view.sending = view.placing = ""  # somebody has thought better of it
        if hit is None:
            view.selected = ""
        elif hit.kind == "candidate":
            view.picked = None if view.picked == hit.index else hit.index
            hub.inspect()
        elif hit.kind == "bin" and self._is_cube(view.selected):
            await self._deliver(visitor, view.selected, hit.name)
        elif hit.kind in SELECTED:
            view.selected = "" if view.selected == hit.name and hit.kind != "object" else hit.name
        elif hit.kind == "floor":
            await self._floor(visitor, hit)
        else:
            view.selected = ""

    def _is_cube(self, name: str) -> bool:
        return self.tick is not None and any(item.name == name for item in self.tick.objects)

    async def _deliver(self, visitor: Visitor, cube: str, box: str) -> None:
        """Add a pick and its place at the end; a cube that waits in the list already goes to this bin instead."""
        index, wanted = None, InsertTask(tasks=(Pick(object=cube), Place(bin=box)))
        planned = None if self.tick is None else waiting_job(self.tick.tasks, cube)
        if planned is not None:
            index, before = planned
            if before == box:
                self._hub.tell(visitor, f"{cube} goes to {box} already", "Task")
                self._hub.view.selected = ""
                return
            if not await self._order(visitor, RemoveTask(index=index)):
                return
            wanted = InsertTask(tasks=wanted.tasks, index=index)
        if await self._order(visitor, wanted):
            instead = "" if planned is None else f", not to {planned[1]}"
            self._hub.tell(visitor, f"{cube} \N{RIGHTWARDS ARROW} {box}{instead or ' added'}", "Task", "green")
            self._hub.view.selected = ""

    async def _floor(self, visitor: Visitor, hit: Hit) -> None:
        view, tick = self._hub.view, self.tick
        x, y = round(float(hit.point[0]), 3), round(float(hit.point[1]), 3)
        if view.sending:
            if await self._order(visitor, SendAgent(name=view.sending, x=x, y=y)):
                view.sending = ""
        elif view.placing and view.placing == view.selected:
            if await self._order(visitor, MoveBody(name=view.selected, x=x, y=y, held=False)):
                view.placing = ""
        elif view.selected:
            view.selected = view.placing = ""
        elif tick is None:
            self._hub.tell(visitor, self._hub.loading() or "nothing runs yet: load a scene first")
        else:
            index = min(tick.task_index, len(tick.tasks))
            if await self._order(visitor, InsertTask(tasks=(DriveTo(point=(x, y)),), index=index)) and tick.preview:
                self._hub.tell(visitor, f"drive to ({x:.2f}, {y:.2f}) is added when time goes on", "Task", "green")

    async def _order(self, visitor: Visitor, command: Command) -> bool:
        """Have a command carried out; a refusal is told by the hub."""
        if reason := self._drag.refusal(visitor):
            self._hub.tell(visitor, reason)
            return False
        return (await asyncio.to_thread(self._hub.command, visitor, command)).ok
