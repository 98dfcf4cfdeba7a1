"""Every number of the stop-then-manipulate methods, with its unit and reason; all are this project's choice."""

import dataclasses
import math

DEG = math.pi / 180.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class StationaryParameters:
    """Where a base may stand, what that costs, and when it stands well enough."""

    manipulability_weight: float = 5.0  # [s] more than the best pose for one without any: none of 0 to 40 s is quicker
    onward_weight: float = 1.0  # of the way on to the next target, in `sequential`: a second is a second on both ways
    arm_clearance: float = 0.13  # [m] to either side of the arm: 0.07 m of forearm, and where it begins to be slowed
    over_cost: float = 100.0  # [s] of a pose with less, to an obstacle outside the map: only when there is no other
    directions: int = 36  # of candidates about the target, as many as the paper's ring has
    headings: int = 16  # at each position, as many as `motm` has where it tries any heading
    radius_step: float = 0.05  # [m] between rings of candidates, as the paper's rings have here
    next_headings: int = 8  # of a next target's poses, at the best position of each direction: half, to save time
    equal_share: float = 0.01  # of the best manipulability: less than that is no difference
    fixed_poses: int = 7  # Paper, Sec. VI, after Reister et al.
    fixed_inset: float = 0.10  # [m] from the edge of a table, where things stand that an arm shall reach
    moved: float = 0.15  # [m] by which the target has moved when the choice is made anew: what is believed errs by 0.1
    park_distance: float = 0.15  # [m] from the chosen pose at which the base may rest: as near as STAA* comes here
    park_share: float = 0.90  # of the manipulability of the chosen pose that it must have there: or it drives on
    park_slack: float = 0.02  # [m] inside the reach, because localisation errs by 1 cm
    goal_distance: float = 0.06  # [m] to which the search must come, and
    goal_heading: float = 10.0 * DEG  # [rad], once the base has become slow too far away: else it would stay there
    slow_v: float = 0.10  # [m/s] and
    slow_w: float = 0.30  # [rad/s] below which a base near its pose creeps
    patience: float = 3.0  # [s] standing on the way, where the map shows one and there is none, until another pose,
    refused_distance: float = 0.20  # [m] this far away at least, is chosen
    stands_v: float = 0.01  # [m/s] and
    stands_w: float = 0.02  # [rad/s] below which the base stands: fingers neither close nor open above
