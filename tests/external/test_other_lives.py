"""Several robots on the keys of one: another one of the same name, one that was started again, a forgery."""

from typing import Any

import msgspec
import pytest
import zenoh
from meeting import Router, driven, running_robot, until
from test_drive import same

from motm_twin.bus.connection import open_member
from motm_twin.bus.keys import PlantKeys
from motm_twin.bus.plant_messages import VERSION
from motm_twin.external.messages import NAMES
from motm_twin.external.plant import ZenohPlant
from motm_twin.external.robot_link import RobotLink
from motm_twin.model.scene import Scene
from motm_twin.twin import Twin


def test_what_another_robot_says_on_the_same_keys_does_not_count_and_is_told(router: Router, scene: Scene) -> None:
    """Each of its messages is one of the robot's own, with another life."""
    inside, keys = Twin(scene), PlantKeys()
    copies: dict[str, bytes] = {}

    def copied(sample: zenoh.Sample) -> None:
        message = msgspec.json.decode(sample.payload.to_bytes())
        if message["life"] != "zz":
            copies[str(sample.key_expr)] = msgspec.json.encode(message | {"life": "zz"})

    spies = [router.session.declare_subscriber(getattr(keys, name), zenoh.handlers.Callback(copied)) for name in NAMES]
    with running_robot(router, scene), driven(router, scene) as outside:
        plant: Any = outside.external
        for k in range(40):
            for key, payload in list(copies.items()):
                router.session.put(key, payload)
            if k == 20:
                until(lambda: plant.link.intruder == "zz")
                assert plant.ready()
                assert plant.text().endswith("another robot (life 'zz') sends on its keys, too, and is not listened to")
            assert same(inside.advance(), outside.advance())
    assert {str(getattr(keys, name)) for name in ("state", "scan", "detections")} <= set(copies)
    for spy in spies:
        spy.undeclare()


STATE = {"version": VERSION, "seq": 0, "stamp": 5.0, "pose": [0.0] * 3, "odometry": [0.0] * 3, "twist": [0.0] * 2,
         "q": [0.0] * 7, "dq": [0.0] * 7, "gripper_width": 0.08, "gripper_moving": False}  # fmt: skip


@pytest.fixture
def link(router: Router):
    """A link to whatever robot there is."""
    found = RobotLink(router.session, "frankie", listen_only=True)
    yield found
    found.close()


def test_a_robot_that_comes_back_after_another_one_is_listened_to_again(router: Router, link: RobotLink) -> None:
    key = PlantKeys("frankie").state
    with open_member(router.endpoint) as robot:

        def says(life: str) -> None:
            robot.put(key, msgspec.json.encode(STATE | {"life": life}))

        def heard(life: str) -> bool:
            says(life)
            return link.newest("state") is not None and link.newest("state").life == life

        def follows(life: str) -> bool:
            says(life)
            return link.successor == life

        until(lambda: heard("first"))
        for life in ("second", "first"):
            until(lambda life=life: follows(life))
            assert link.newest("state").life == link.life != life  # until the twin turns to it
            link.live(life)
            assert (link.newest("state").life, link.successor) == (life, "")
            until(lambda life=life: heard(life))


def test_somebody_else_in_the_silence_of_a_robot_does_not_take_its_place(router: Router, scene: Scene) -> None:
    """The robot is asked who it is before anybody is believed to be its successor; the run goes on where it was."""
    inside = Twin(scene)
    with running_robot(router, scene) as robot, driven(router, scene) as outside:
        plant: Any = outside.external
        assert isinstance(plant, ZenohPlant)
        for _ in range(5):
            assert same(inside.advance(), outside.advance())

        def follows() -> bool:  # a robot with a shared clock is silent between two periods
            router.session.put(plant.link.keys.state, msgspec.json.encode(STATE | {"life": "zz"}))
            return plant.link.successor == "zz"

        until(follows)
        until(plant.ready)
        assert (plant.link.life, plant.link.successor) == (robot.robot.life, "")
        for _ in range(5):
            assert same(inside.advance(), outside.advance())
