"""A panel without a browser, and somebody who uses it."""

import asyncio
import json
import threading
import time
from types import SimpleNamespace

import msgspec
import viser

from motm_twin.bus.commands import Answer
from motm_twin.bus.messages import BeliefMessage, SceneChoice, StatusMessage
from motm_twin.ui.history import History
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.panel.panel import ASK, Panel

replace = msgspec.structs.replace
ENCODE = msgspec.json.Encoder().encode


def status(**changes):
    """The state of a server that plays exp2."""
    fields = {
        "version": "motm.status/1", "twin": "frankie", "run": 1, "server_time": 0.0, "state": "playing", "text": "",
        "scene": "exp2", "variant": "random", "seed": 0, "time": 1.0, "speed": 1.0, "actual_speed": 1.0,
        "capped": False, "scenes": [],
    }  # fmt: skip
    return StatusMessage(**{**fields, **changes})


def with_arm(tick, **changes):
    """A tick with other arm steps."""
    return replace(tick, arm=[replace(step, **changes) for step in tick.arm])


def in_hand(tick, kind):
    """The tick with this kind of task active, and the cube held when it is to be placed."""
    number = next(k for k, task in enumerate(tick.tasks) if task.kind == kind)
    held = kind == "place"
    belief = BeliefMessage(name="cube1", position=[0, 0, 0], yaw=0.0, position_sd=0.0, seen=True, held=held)
    return replace(tick, task_index=number, beliefs=[belief])


class Client:
    """Stands where a TwinClient does: keeps what it is told and answers as the server would."""

    sender, alive, endpoint = "page", True, "tcp/none"

    def __init__(self):
        self.now, self.told, self.answer, self.arrived = None, [], Answer(ok=True), threading.Semaphore(0)

    @property
    def heard(self):
        return [command for command, *_ in self.told]

    def status(self):
        return self.now

    def grid(self):
        return None

    def session(self):
        return b"{}"

    def command(self, command, timeout=0.0, *, sender="", name=""):
        self.told.append((command, sender, name))
        self.arrived.release()
        return self.answer


class Page:
    """Stands where a connected browser page does; its widgets are those of a server without visitors."""

    def __init__(self, gui=None, number=0):
        self.client_id, self.gui, self.notes, self.removed, self.files = number, gui, [], [], []
        eye = {"position": (-1.0, -4.0, 6.0), "look_at": (3.0, 1.0, 0.0), "fov": 0.8}
        self.camera = SimpleNamespace(**eye, image_width=900, image_height=800)

    def add_notification(self, title, text, **_):
        self.notes.append(text)
        return SimpleNamespace(remove=lambda: self.removed.append(text))

    def send_file_download(self, name, content, **_):
        self.files.append((name, content))


class Person:
    """A panel, and somebody who uses it."""

    def __init__(self, server, scene, ticks):
        self.scene, self.ticks = scene, ticks
        self.client = Client()
        self.hub = Hub(self.client)
        self.hub.history = History()
        for tick in ticks:
            self.hub.history.add(ENCODE(tick))
        self.page = Page(server.gui)
        self.visitor = self.hub.enter(self.page)
        self.sent = []
        self.hub.send = self._send
        self.cameras, self.drives = [], []
        cameras = SimpleNamespace(choose=lambda _, preset: self.cameras.append(preset), mode=lambda _: "Overview")
        scene_view = SimpleNamespace(cameras=cameras, clicks=SimpleNamespace(drive=lambda _: self.drives.append(1)))
        self.panel = Panel(self.hub, self.visitor, scene_view)
        self.widgets = server.gui._gui_input_handle_from_uuid
        self.status = status(driver=self.visitor.sender, driver_name="Ann", scenes=[
            SceneChoice(name="exp2", title="", variants=["random", "still"]),
            SceneChoice(name="exp1", title="", variants=["trial1"]),
        ])  # fmt: skip

    def _send(self, visitor, command):
        visitor.sent = time.monotonic()
        self.sent.append(command)

    def shows(self, state="playing", tick=None, **changes):
        """Let the panel show this."""
        self.status = replace(self.status, state=state, **changes)
        self.client.now = self.status
        newest = self.ticks[-1] if tick is None else tick
        at = self.hub.view.at
        shown = newest if at is None else self.hub.history.at(at)
        said = {"state": state, "status": self.status, "scene": self.scene, "view": self.hub.view}
        self.panel.update(Shown(**said, tick=shown, newest=newest, live=at is None))

    def widget(self, text):
        """The widget with this label, or the row of buttons with one of this name."""
        found = [widget for widget in self.widgets.values() if label(widget) == text] or self._rows(text)
        assert found, f"no widget {text!r}"
        return found[0]

    def _rows(self, text):
        return [w for w in self.widgets.values() if isinstance(w, viser.GuiButtonGroupHandle) and text in w.options]

    def presses(self, text, number=0):
        """Press a button, or one in a row."""
        rows = self._rows(text)
        if rows:
            rows[number]._impl.value = text
        self._does(rows[number] if rows else self.widget(text))

    def selects(self, name):
        """Select a thing, once the panel shows that; its name."""
        self.chooses("Selected", name)
        self.shows()
        return name

    def asks(self, *words):
        """Ask for something as the script of the page does."""
        self.chooses(ASK, json.dumps([1, *words]))

    def chooses(self, label, value):
        """Set a slider, list or box."""
        widget = self.widget(label)
        widget._impl.value = value
        self._does(widget)

    def _does(self, widget):
        self.sent.clear()
        assert not is_disabled(widget), f"{widget.label!r} is grey"
        for callback in widget._impl.update_cb:
            asyncio.run(callback(SimpleNamespace(client_id=0, target=widget)))

    @property
    def last(self):
        return self.sent[-1]


def label(widget):
    """What stands beside a widget, or on a button."""
    return getattr(widget._impl.props, "label", "")


def is_disabled(widget):
    """A widget that cannot be used now."""
    return getattr(widget._impl.props, "disabled", False)
