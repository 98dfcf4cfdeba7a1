"""Gymnasium, which is an extra: imported in one place, so that one sentence says what to do where it is missing."""

import sys

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise ImportError(
        f"motm_twin.gym needs Gymnasium, which is not installed: {sys.executable} -m pip install 'gymnasium>=1.0'"
    ) from error

__all__ = ["gymnasium", "spaces"]
