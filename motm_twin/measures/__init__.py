"""Measures of a trial, computed from its Ticks alone, and reference times for comparison."""

from motm_twin.measures.measures import Measures

__all__ = ["Measures"]
