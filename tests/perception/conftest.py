"""The small world for every perception test."""

from .small_world import known

__all__ = ["known"]
