import time


def until(condition, what, timeout=20.0):
    """Wait for something that must happen; how fast is not the test's business."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"after {timeout:.0f} s: {what}")
