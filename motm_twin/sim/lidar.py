"""The 2D lidar: sees only what exists at its own height, the arm excepted."""

from dataclasses import dataclass, field

import numpy as np

from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.plant import Scan
from motm_twin.model.profile import Lidar as LidarSpec
from motm_twin.sim.kernels import cast_rays


@dataclass
class LidarState:
    """Noise, the newest sweep, and sweeps that are on their way."""

    rng: np.random.Generator
    scan: Scan | None = None
    late: list[tuple[int, Scan]] = field(default_factory=list)  # substep of arrival, sweep

    def arrive(self, now: int) -> None:
        """The newest of the late sweeps that are here at substep ``now`` becomes the newest sweep."""
        here = [scan for arrival, scan in self.late if arrival <= now]
        if here:
            self.scan = here[-1]
            self.late = [entry for entry in self.late if entry[0] > now]


class Lidar:
    """Casts the beams of one sweep at one instant, from the true pose of the base."""

    def __init__(self, spec: LidarSpec, range_sd: float) -> None:
        """Sensor of the profile and sd of a range [m]."""
        self.spec = spec
        self.angle_min = -0.5 * spec.field_of_view
        self.angle_step = spec.field_of_view / max(1, spec.beams - 1)
        self._origin = np.array([spec.x, spec.y])
        self._range_sd = range_sd

    def sweep(
        self, state: LidarState, stamp: float, pose: Array, localised: Array, segments: Array, discs: Array
    ) -> None:
        """Replace the newest scan; segments (s, 4) and discs (d, 3) are what exists at the lidar's height."""
        spec = self.spec
        ranges = cast_rays(
            from_frame(pose, self._origin),
            float(pose[2]) + self.angle_min,
            self.angle_step,
            spec.beams,
            segments,
            discs,
            spec.range_max,
        )
        if self._range_sd > 0.0:
            ranges = ranges + self._range_sd * state.rng.standard_normal(spec.beams)
            ranges[ranges > spec.range_max] = np.inf
        state.scan = Scan(
            stamp=stamp,
            ranges=np.maximum(ranges, spec.range_min),
            angle_min=self.angle_min,
            angle_step=self.angle_step,
            origin=self._origin,
            range_min=spec.range_min,
            range_max=spec.range_max,
            pose=localised.copy(),
        )
