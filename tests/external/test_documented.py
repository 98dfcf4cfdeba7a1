"""What is written about robots in other programs stays true."""

import re
from pathlib import Path

import pytest

from motm_twin.bus.keys import PlantKeys
from motm_twin.bus.plant_messages import DetectionList, Info, RobotCommand, RobotState, ScanData
from motm_twin.external.messages import scan_of
from motm_twin.model.profile import Lidar
from motm_twin.perception.scan import CheckedScan, RefusedScan, check_scan

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "external_robot.md").read_text(encoding="utf-8")


def test_the_page_leads_to_the_skeleton_and_names_what_is_replaced_in_it() -> None:
    skeleton = (ROOT / "examples" / "robot_skeleton.py").read_text(encoding="utf-8")
    assert "](../examples/robot_skeleton.py)" in PAGE
    assert "`Drives`" in PAGE and "\nclass Drives:" in skeleton
    assert len(skeleton.splitlines()) < 130  # "a hundred lines"


def test_the_page_names_every_key() -> None:
    keys = PlantKeys()
    named = [key.removeprefix(keys.root + "/") for name, key in vars(keys).items() if name not in ("twin", "root")]
    assert [key for key in named if f"`{key}`" not in PAGE] == []


@pytest.mark.parametrize(
    ("title", "kind"),
    [
        ("info", Info),
        ("state", RobotState),
        ("scan", ScanData),
        ("detections", DetectionList),
        ("command", RobotCommand),
    ],
)
def test_the_examples_of_messages_can_be_read(title: str, kind: type) -> None:
    import msgspec

    match = re.search(rf"<!-- {title} -->\n```json\n(.*?)```", PAGE, re.S)
    assert match is not None
    assert msgspec.json.decode(match[1].encode(), type=kind).version == "motm.plant/1"


def test_the_example_of_a_scan_is_one_that_a_lidar_of_so_many_beams_makes() -> None:
    import msgspec

    match = re.search(r"<!-- scan -->\n```json\n(.*?)```", PAGE, re.S)
    assert match is not None
    data = msgspec.json.decode(match[1].encode(), type=ScanData)
    scan = scan_of(data, 0.0)
    assert isinstance(check_scan(scan, Lidar(beams=len(data.ranges)), data.stamp), CheckedScan)
    assert isinstance(check_scan(scan, Lidar(), data.stamp), RefusedScan)
    assert f"{Lidar().beams} for Frankie" in PAGE
