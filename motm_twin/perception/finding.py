"""A finding: a fault or disturbance of its own sensors, wheels or joints that the robot has noticed."""

import msgspec

from motm_twin.model.reason import Kind, Reason

HALF = 0.5  # share of its speed that the base keeps while its sensor data are only partly good


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One present fault or disturbance, and the share of its speed that the base keeps because of it."""

    reason: Reason  # its kind is one of `KINDS`, its subject a sensor or part: lidar, camera, wheels, joint 4, fingers
    base: float = 1.0  # share of its speed that the base keeps; 0: it stands

    @property
    def kind(self) -> Kind:
        """One of `KINDS`."""
        return self.reason.kind

    @property
    def subject(self) -> str:
        """Sensor or part that the finding is about."""
        return self.reason.subject

    @property
    def consequence(self) -> Reason:
        """The reason, with its effect on the base: stopped, slowed, or none."""
        if self.base == 1.0:
            return self.reason
        return Reason(
            kind=Kind.STOPPED if self.base == 0.0 else Kind.SLOWED, subject=self.subject, value=self.base,
            cause=self.reason,
        )  # fmt: skip


KINDS = {
    "scan_bad": "a sweep whose numbers cannot be used",
    "scan_old": "sweeps that come late, or no more",
    "state_old": "what the robot says of its motion comes late",
    "scan_frozen": "the same sweep again and again",
    "scan_blind": "nothing returns where the map says that something must, or all returns went at once",
    "scan_sector": "a part of the beams never returns where others see mapped furniture",
    "scan_noisy": "ranges that scatter more than a map of them can bear",
    "pose_off": "a localised pose that neither odometry nor scan agrees with",
    "pose_lost": "the same, after so long a way by odometry alone that the robot may be anywhere",
    "pushed": "a jump of the localised pose that the scan agrees with: the robot was pushed",
    "slip": "wheels that turn more than the robot moves",
    "odometry_off": "odometry that moved as no wheel can",
    "base_late": "a base that follows its commands later than its profile says",
    "base_stuck": "a base that does not follow its commands",
    "joint_stuck": "a joint that does not follow its commands",
    "fingers_stuck": "fingers that do not follow their command",
    "camera_ghost": "an object reported where the camera cannot see it",
    "camera_twice": "an object reported at two places",
    "camera_unknown": "something reported where no object is known",
    "camera_swap": "an object reported where another one stands",
    "camera_lost": "an object that is in view, and no longer reported",
    "camera_late": "pictures that are old, or do not come",
}
