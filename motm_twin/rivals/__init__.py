"""Rival methods on the same robot: holistic control, MotM of 2022, ORCA, stop-then-manipulate, open loop."""
