"""The control period and the steps of the arm in it."""

PERIOD = 0.05  # [s] the paper's 20 Hz (Sec. IV)
PERIODS_PER_SECOND = round(1.0 / PERIOD)
ARM_STEPS = 5  # arm steps in a period: 100 Hz
