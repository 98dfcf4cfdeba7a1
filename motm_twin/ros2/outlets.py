"""Publishers and subscribers of the topics on one Zenoh session, with their tokens."""

import time
from collections.abc import Callable

import zenoh
import zenoh.ext

from motm_twin.bus.connection import direct
from motm_twin.ros2.cdr import Message, encode
from motm_twin.ros2.forms import ACCEPTED, PUBLISHED, PUBLISHER, SUBSCRIBER, Form, Topic


class Outlet:
    """One published topic."""

    def __init__(self, session: zenoh.Session, form: Form, topic: Topic, number: int) -> None:
        self._form, self._topic, self._sequence = form, topic, 0
        self._name = form.token(topic, PUBLISHER, number)
        self._publisher = (
            _latched(session, form, topic) if topic.latched else session.declare_publisher(form.key(topic))
        )
        self._token = session.liveliness().declare_token(self._name)

    def put(self, message: Message) -> None:
        """Send a message to whoever subscribes; a slow reader misses it rather than hold it up. Raises CdrError."""
        payload = encode(self._topic.message, message)
        self._sequence += 1
        attachment = self._form.attachment(self._name, self._sequence, time.time_ns())
        self._publisher.put(payload, attachment=attachment)

    def close(self) -> None:
        """Withdraw it."""
        self._token.undeclare()
        self._publisher.undeclare()


class Outlets:
    """All topics: what is published, and what is accepted."""

    def __init__(self, session: zenoh.Session, form: Form, accept: Callable[[Topic, bytes], None]) -> None:
        """``accept`` is called in Zenoh's thread with the bytes of every message that comes: it must be quick."""
        liveliness = session.liveliness()
        self._tokens = [liveliness.declare_token(token) for token in form.own_tokens()]
        self._outlets = {topic: Outlet(session, form, topic, number) for number, topic in enumerate(PUBLISHED)}
        self._subscribers = []
        for number, topic in enumerate(ACCEPTED, len(PUBLISHED)):
            self._subscribers.append(session.declare_subscriber(form.key(topic), _handler(topic, accept)))
            self._tokens.append(liveliness.declare_token(form.token(topic, SUBSCRIBER, number)))

    def put(self, topic: Topic, message: Message) -> None:
        """Publish a message."""
        self._outlets[topic].put(message)

    def close(self) -> None:
        """Withdraw everything."""
        for declared in (*self._tokens, *self._subscribers):
            declared.undeclare()
        for outlet in self._outlets.values():
            outlet.close()


def _latched(session: zenoh.Session, form: Form, topic: Topic) -> zenoh.ext.AdvancedPublisher:
    """Keeps the last messages for late joiners in the way of both forms since 2025, Zenoh's advanced publisher."""
    return zenoh.ext.declare_advanced_publisher(
        session,
        form.key(topic),
        cache=zenoh.ext.CacheConfig(max_samples=topic.depth),
        sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
        publisher_detection=True,
    )


def _handler(topic: Topic, accept: Callable[[Topic, bytes], None]) -> zenoh.handlers.Callback:
    return direct(lambda sample: accept(topic, sample.payload.to_bytes()))
