"""The control period and the steps of the arm in it."""

PERIOD = 0.05  # [s] the paper's 20 Hz (Sec. IV)
ARM_STEPS = 5  # arm steps in a period: 100 Hz
