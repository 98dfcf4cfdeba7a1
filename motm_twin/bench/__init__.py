"""Experiments, reference tours and benchmarks."""
