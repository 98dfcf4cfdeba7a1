"""When the arm leaves for the target, and how long it takes: the transit rule of MotM."""

import msgspec


class TransitRule(msgspec.Struct, frozen=True, kw_only=True):
    """Leave when the expected transit, distance / (v_B k_A), is as long as the target needs to come into range."""

    k_A: float = 0.5  # MotM; 0.25 to 1.0 are stable
    base_speed: float = 0.3  # [m/s] v_B is taken as at least this: a turning or braking base soon drives again
    hand_speed: float = 0.9  # [m/s] a transit is never planned faster than this

    def transit_duration(self, distance: float, speed: float, time_to_range: float) -> float | None:
        """Seconds to take for the remaining distance [m] at base speed [m/s]; None: do not start yet."""
        expected = distance / (max(abs(speed), self.base_speed) * self.k_A)
        if expected < time_to_range:
            return None
        return max(time_to_range, distance / self.hand_speed)
