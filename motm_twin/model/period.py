"""The control period."""

PERIOD = 0.05  # [s] the paper's 20 Hz (Sec. IV)
