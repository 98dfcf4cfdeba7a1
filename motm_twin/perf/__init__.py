"""Benchmarks of a period, the page, the bus and long runs; the processes that take part speak one protocol."""
