"""A Temi that chases the robot: its position is set from here, ten times a second, and the robot copes.

python examples/chasing_obstacle.py --seconds 30
"""

import argparse
import math

from motm_twin.client import connect
from motm_twin.program import clean_exit

NAME = "chaser"
SPEED = 0.4  # [m/s]
NEAR = 0.9  # [m] from the middle of the base: it is a nuisance, not a battering ram
START = 3.0  # [m] behind the robot
EVERY = 0.1  # [s]


@clean_exit()
def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--endpoint")
    parser.add_argument("--twin")
    parser.add_argument("--seconds", type=float, default=30.0, help="simulated time of the chase")
    options = parser.parse_args()
    with connect(options.endpoint, options.twin, name="chasing obstacle") as twin:
        x, y, heading = next(twin.ticks(timeout=60.0)).robot.pose  # a twin that is loading has none yet
        x, y = x - START * math.cos(heading), y - START * math.sin(heading)
        twin.add_obstacle(NAME, x, y, shape="temi")
        twin.play()
        began = last = twin.latest_tick().time
        nearest = math.inf
        for tick in twin.ticks(timeout=10.0):
            if tick.time - last < EVERY:
                continue
            robot_x, robot_y, _ = tick.robot.pose
            away = math.hypot(robot_x - x, robot_y - y)
            nearest = min(nearest, away)
            way = max(0.0, min(SPEED * (tick.time - last), away - NEAR))
            heading = math.atan2(robot_y - y, robot_x - x)
            x, y, last = x + way * math.cos(heading), y + way * math.sin(heading), tick.time
            twin.move(NAME, x, y, heading)
            if tick.time - began >= options.seconds:
                break
        twin.remove(NAME)
        twin.hand_over()
    contacts = len(tick.score.contacts)
    print(f"chased for {last - began:.1f} s, nearest {nearest:.2f} m, {contacts} contacts")


if __name__ == "__main__":
    main()
