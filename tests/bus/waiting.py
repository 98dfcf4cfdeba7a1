import time


def until(condition, what="it did not come true", timeout=60.0):
    """Wait for something that must happen; how fast is not the test's business."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"after {timeout:.0f} s: {what}")


def asked(session, selector, payload=None):
    """Replies to a query. Who has just connected hears of one queryable after the other: it is asked again."""
    return until(lambda: list(session.get(selector, payload=payload, timeout=5.0)), f"nobody answers {selector}")


def until_paused(server, timeout=240.0):
    """Wait for a server's twin to stand at its start; the first start of a real one compiles."""
    until(lambda: server.loop.status().state == "paused", "the twin never started", timeout)
