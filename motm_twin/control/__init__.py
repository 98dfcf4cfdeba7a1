"""Arm reference, redundancy resolution, task sequence, monitor and the period itself."""
