"""What a trial was like, read from its Ticks alone: where time went, how near others came, how smooth it was."""

from motm_twin.bench.measures.measures import Measures

__all__ = ["Measures"]
