"""Methods that others published, on the same robot: holistic control, MotM of 2022, stop-then-manipulate, open loop."""
