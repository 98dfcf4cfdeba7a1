"""Every tunable number of the robot's program in one tree; each says unit, source and reason (`model/number.py`)."""

import msgspec

from motm_twin.control.arm.monitor import ArmMonitorParameters
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.monitor import MonitorParameters
from motm_twin.control.progress import ProgressParameters
from motm_twin.control.response import ResponseSettings
from motm_twin.control.self_check import SelfCheckSettings
from motm_twin.control.sequence import SequenceParameters
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.objects import TrackerSettings
from motm_twin.perception.tracks import TrackParameters
from motm_twin.planning.parameters import PlanningParameters


class Parameters(msgspec.Struct, frozen=True, kw_only=True):
    """The tree, in the order of a period: perception, planning of the base, the arm, checks."""

    map: MapSettings = MapSettings()
    tracks: TrackParameters = TrackParameters()
    objects: TrackerSettings = TrackerSettings()
    planning: PlanningParameters = PlanningParameters()
    arm: ArmParameters = ArmParameters()
    monitor: MonitorParameters = MonitorParameters()
    arm_monitor: ArmMonitorParameters = ArmMonitorParameters()
    progress: ProgressParameters = ProgressParameters()
    sequence: SequenceParameters = SequenceParameters()
    self_check: SelfCheckSettings = SelfCheckSettings()
    response: ResponseSettings = ResponseSettings()
