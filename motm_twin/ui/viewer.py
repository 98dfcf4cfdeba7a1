"""The viewer process: a Zenoh client that draws ticks with Viser and posts commands.

It can be started, stopped and restarted at any time; the twin does not notice. Alone:
``python -m motm_twin.ui.viewer_process --endpoint tcp/127.0.0.1:7447 --port 8080``.
"""

import itertools
import queue
import threading
import time
import traceback

import numpy as np
import viser

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Command
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.model.edits import AddObstacle, RemoveBody
from motm_twin.model.scene import Scene
from motm_twin.ui.body_view import BodyView
from motm_twin.ui.camera import Cameras
from motm_twin.ui.drag import Drag
from motm_twin.ui.free_place import free_place
from motm_twin.ui.map_view import MapView
from motm_twin.ui.panels import Actions, Panels
from motm_twin.ui.plan_view import PlanView
from motm_twin.ui.robot_view import RobotView
from motm_twin.ui.scene_view import SceneView

FRAME = 1.0 / 30.0  # [s] at most thirty pictures a second
SLOW = 0.1  # [s] between updates of ghosts, candidates and texts
NOTE_TIME = 6.0  # [s] a refusal stays on the page
SIZES = {"temi": (0.5, 0.5, 1.0), "box": (0.4, 0.4, 0.6)}


class Viewer:
    """Draws one twin on one Viser server. `run` returns after `stop`."""

    def __init__(self, server: viser.ViserServer, client: TwinClient) -> None:
        self._server, self._client = server, client
        self._stop = threading.Event()
        self._commands: queue.Queue[Command] = queue.Queue(maxsize=100)
        self._note, self._note_until = "", 0.0
        self._numbers = itertools.count(1)
        self._added: dict[str, tuple[float, float]] = {}  # asked for, not yet in a tick
        self._drag = Drag(client, self._report)
        self._scene_view, self._robot = SceneView(server), RobotView(server)
        self._bodies, self._map = BodyView(server, self._drag), MapView(server)
        self._plan = PlanView(server, self._pick)
        self._cameras = Cameras(server)
        actions = Actions(self._queue_command, self._add, self._clear, self._layer, self._forget_candidate)
        self._panels = Panels(server, self._cameras, actions)
        server.on_client_connect(self._panels.greet)
        self._scene: Scene | None = None
        self._tick: TickMessage | None = None
        self._run_shown = -1
        self._slow_at = 0.0
        self._sender = threading.Thread(target=self._send_commands, name="commands", daemon=True)

    def stop(self) -> None:
        """Make `run` return."""
        self._stop.set()

    def run(self) -> None:
        """Draw until `stop`; an error in drawing is shown on the page and drawing goes on."""
        self._sender.start()
        seen, last = 0, time.monotonic()
        while not self._stop.is_set():
            seen = self._client.wait_tick(seen, FRAME)
            now = time.monotonic()
            try:
                self._draw(now, now - last)
            except Exception as error:
                traceback.print_exc()
                self._report(f"drawing: {type(error).__name__}: {error}")
                self._stop.wait(1.0)
            last = now
            self._stop.wait(max(0.0, FRAME - (time.monotonic() - now)))
        self._drag.stop()

    def _draw(self, now: float, dt: float) -> None:
        status = self._client.status()
        slow = now >= self._slow_at
        if slow:
            self._slow_at = now + SLOW
            self._show_status(status)
        scene = self._client.scene()
        if scene is not None and scene is not self._scene:
            self._show_scene(scene)
        tick = self._client.tick()
        if tick is not None and self._scene is not None:
            self._show_tick(tick, slow)
            self._cameras.update(np.array(tick.robot.true_pose), dt)

    def _show_scene(self, scene: Scene) -> None:
        self._scene = scene
        self._scene_view.show(scene)
        self._robot.configure(scene.robot)
        self._bodies.show(scene)
        self._cameras.show(scene)
        self._plan.picked = None
        status = self._client.status()
        if status is not None:
            self._panels.adopt_scene(status)

    def _show_tick(self, tick: TickMessage, slow: bool) -> None:
        new, self._tick = tick is not self._tick, tick
        for body in tick.obstacles:
            self._added.pop(body.name, None)
        with self._server.atomic():
            if new:
                self._robot.update(tick)
            self._bodies.update(tick)
        if slow:
            with self._server.atomic():
                self._robot.update_ghosts(tick)
                self._plan.update(tick)
            self._bodies.update_trails()
            self._map.update(self._client.grid())
            self._panels.show_tick(tick, self._plan.picked)

    def _show_status(self, status: StatusMessage | None) -> None:
        note = self._note if time.monotonic() < self._note_until else ""
        if status is None:
            text = f"no twin server at {self._client.endpoint} yet; this page connects by itself"
            self._panels.show_status("waiting", None, text)
        elif not self._client.alive:
            self._panels.show_status("lost", status, "the twin server is silent; this page reconnects by itself")
        else:
            self._panels.show_status(status.state, status, note or status.text)

    def _queue_command(self, command: Command) -> None:
        try:
            self._commands.put_nowait(command)
        except queue.Full:
            self._report("too many commands at once")

    def _send_commands(self) -> None:
        while not self._stop.is_set():
            try:
                command = self._commands.get(timeout=0.2)
            except queue.Empty:
                continue
            answer = self._client.command(command)
            if not answer.ok:
                self._report(answer.reason)

    def _report(self, text: str) -> None:
        self._note, self._note_until = text, time.monotonic() + NOTE_TIME

    def _add(self, kind: str) -> None:
        tick, scene = self._tick, self._scene
        if tick is None or scene is None:
            return
        bodies = (*tick.agents, *tick.obstacles)
        names = {body.name for body in bodies} | {solid.name for solid in scene.solids} | set(self._added)
        taken = [body.position[:2] for body in bodies] + list(self._added.values())
        x, y, heading = free_place(tick.robot.true_pose, self._client.grid(), taken)
        name = next(n for i in self._numbers if (n := f"{kind} {i}") not in names)
        self._added[name] = (x, y)
        self._queue_command(AddObstacle(name=name, shape=kind, x=x, y=y, heading=heading, size=SIZES[kind]))

    def _clear(self) -> None:
        self._added.clear()
        for body in self._tick.obstacles if self._tick else ():
            self._queue_command(RemoveBody(name=body.name))

    def _pick(self, index: int) -> None:
        self._plan.picked = None if self._plan.picked == index else index

    def _forget_candidate(self) -> None:
        self._plan.picked = None

    def _layer(self, name: str, on: bool) -> None:
        match name:
            case "Occupancy grid":
                self._map.on = on
            case "Candidates":
                self._plan.candidates_on = on
            case "Paths":
                self._plan.paths_on = on
            case "Ghosts":
                self._robot.ghosts_on = on
            case "Trails":
                self._bodies.trails_on = on
