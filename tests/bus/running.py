"""A loop in its thread, with commands that wait for their answers."""

import threading
import time

from fake_twin import FakeLibrary, FakeTwin
from waiting import until

from motm_twin.bus.commands import Envelope, Load, Step
from motm_twin.bus.library import FileLibrary, TwinSetup
from motm_twin.bus.loop import TwinLoop
from motm_twin.bus.server import TwinServer
from motm_twin.twin import Twin


def real_server(*, make_twin=Twin, playing=True, **options):
    """A server of Experiment 1."""
    first = Load(scene="exp1")
    setup = TwinSetup(library=FileLibrary("exp1"), make_twin=make_twin, first=first, playing=playing)
    return TwinServer(setup, **options)


class Sink:
    """Collects what the loop says."""

    def __init__(self):
        self.ticks, self.scenes, self.states, self.events = [], [], 0, []

    def tick(self, message, tick, last):
        self.ticks.append(message)

    def scene(self, scene, run):
        self.scenes.append(scene)

    def status(self):
        self.states += 1

    def event(self, **about):
        self.events.append(about)


class Running:
    """A loop in its thread, with commands that wait for their answers."""

    def __init__(self, make_twin=FakeTwin, playing=False, first="fake", library=None, data=None, **options):
        """``options``: of the `TwinSetup`."""
        self.sink, self.library = Sink(), library or FakeLibrary()
        self.twins = []

        def make(scene, *, method):
            self.twins.append(make_twin(scene, method=method))
            return self.twins[-1]

        first = first if isinstance(first, Load) else Load(scene=first)
        setup = TwinSetup(library=self.library, make_twin=make, first=first, playing=playing, **options)
        self.loop = TwinLoop(setup, twin_name="t", sink=self.sink, data=data)
        self.thread = threading.Thread(target=self.loop.run)

    def __enter__(self):
        self.thread.start()
        until(lambda: self.loop.status().state != "loading", "the loop never left loading", 240.0)
        return self

    def __exit__(self, *_):
        self.loop.stop()
        self.thread.join(10.0)
        assert not self.thread.is_alive()

    def ask(self, command, sender="ann", name="Ann", expires=60.0):
        """Send a command and wait for all its effects; the reason of a refusal, "" when it was done."""
        answers, answered = [], threading.Event()
        expires += time.time()

        def reply(reason, index):
            answers.append((reason, index))
            answered.set()

        envelope = Envelope(sender=sender, name=name, seq=1, expires=expires, command=command)
        self.loop.request(envelope, reply)
        assert answered.wait(60.0)
        done = threading.Event()
        self.loop.session(lambda *_: done.set())
        assert done.wait(60.0)
        until(lambda: not self.loop._outdated, "what was changed is not shown")
        return answers[0][0]

    def step(self, count=1):
        index = self.last.index
        assert self.ask(Step(count=count)) == ""
        until(lambda: self.last.index == index + count and not self.last.preview, "the steps were not made")

    @property
    def last(self):
        return self.sink.ticks[-1]
