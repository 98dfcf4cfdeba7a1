"""The control period and the steps of the arm in it."""

PERIOD = 0.05  # [s] the paper's 20 Hz (Sec. IV)
A_PERIOD_AND_A_BIT = 1.2 * PERIOD  # [s] up to which the next one may come
PERIODS_PER_SECOND = round(1.0 / PERIOD)
ARM_STEPS = 5  # arm steps in a period: 100 Hz
ARM_STEP = PERIOD / ARM_STEPS  # [s]
