"""What the referee has seen, for the tests of staged contacts."""

from sim_hands import act


def hits(plant, other=None):
    return [item for item in plant.truth().contacts if other in (None, item.other)]


def verdicts(plant, other=None):
    return [item.caused_by_robot for item in hits(plant, other)]


def drive(plant, speed, seconds, yaw_rate=0.0):
    plant.command(act((speed, yaw_rate)))
    plant.step(seconds)
