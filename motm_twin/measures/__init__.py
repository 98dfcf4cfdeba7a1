"""Measures of a trial, read from its Ticks alone, and the times that a trial is compared with."""

from motm_twin.measures.measures import Measures

__all__ = ["Measures"]
