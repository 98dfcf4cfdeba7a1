"""The arm side of the control period (Paper, Sec. V): phases, motion of the hand, limits, program, monitor."""
