"""The recorded run."""

from recorded_run import clocked, clocked_twin, disturbances, recorded

__all__ = ["clocked", "clocked_twin", "disturbances", "recorded"]
