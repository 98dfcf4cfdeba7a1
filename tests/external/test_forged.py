"""Others on the keys of a robot: a forger, another robot of the same name, and one that was started again."""

import msgspec
import pytest
import zenoh
from meeting import STATE, driven, running_robot, server_for_a_robot
from test_drive import same
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import COMMAND_NAMES
from motm_twin.bus.connection import Keys, PlantKeys, open_member
from motm_twin.bus.plant_messages import VERSION, ClockGrant, RobotCommand
from motm_twin.external.plant import GONE
from motm_twin.external.robot import MAX_JUMP, SILENCE
from motm_twin.external.robot_link import NAMES, RobotLink
from motm_twin.twin import Twin

KEYS = PlantKeys()
WILD = ("motm/**", "**", "motm/*/plant/*", "motm/frankie/plant/comm$*", "motm/frankie/plant/gr$*")


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A server whose robot comes to its own port."""
    with server_for_a_robot(tmp_path_factory.mktemp("data")) as server:
        yield server


def forged(life, seq, act_at):
    return msgspec.json.encode(
        RobotCommand(
            version=VERSION, life=life, sender="twin", seq=seq, act_at=act_at, twist=[0.5, 0.0],
            joint_velocity=[0.5] * 7, gripper="open", lifetime=0.3,
        )
    )  # fmt: skip


def forge(session, robot):
    """What drove the robot past the monitor: on every key, and on wildcards that match it."""
    mine = robot.robot
    newest = mine._guard._acting.seq if mine._guard._acting is not None else 0
    for ahead in (0.0, 0.05, 0.2):
        for key in (KEYS.command, *WILD):
            session.put(key, forged(mine.life, newest + 10**6, mine.time + ahead))
    for key in (KEYS.grant, *WILD):
        session.put(key, msgspec.json.encode(ClockGrant(version=VERSION, life=mine.life, until=mine.time + 0.9)))
    request = msgspec.json.encode({"version": VERSION, "check": False})
    for key in (KEYS.reset, KEYS.edit, KEYS.tasks, *WILD[:3]):
        session.get(key, zenoh.handlers.Callback(lambda reply: None), payload=request, timeout=0.2)


def test_forged_commands_do_not_reach_the_robot_and_it_goes_on(served, scene):
    heard = []
    met = type("Met", (), {"endpoint": served.endpoint})
    with running_robot(met, scene) as robot, TwinClient(served.endpoint) as client:
        until(lambda: client.tick() and client.tick().index > 3, timeout=240.0)  # the first start compiles
        mine = robot.robot
        life, offer, run = mine.life, mine.command, client.tick().run
        mine.command = lambda payload: (heard.append(msgspec.json.decode(payload)["seq"]), offer(payload))
        with open_member(served.endpoint, wait=5.0) as forger:
            for _ in range(3):
                forge(forger, robot)
                at = client.tick().index
                until(lambda at=at: client.tick().index > at + 3)
        assert (mine.life, mine._guard.refused, client.tick().run) == (life, 0, run)
        assert heard == sorted(heard)
        assert max(heard) - min(heard) < MAX_JUMP  # all are the twin's


def test_nobody_else_speaks_for_the_twin_or_its_robot_through_a_wildcard(served):
    """A put and an answer on a wildcard pass the access control of the keys that it matches."""
    keys = Keys("frankie")
    with open_member(served.endpoint, wait=5.0) as forger, TwinClient(served.endpoint) as client:
        until(client.status)
        for name in ("robot", "metrics", "scan"):
            client.follow(getattr(keys, name))
        false = forger.declare_queryable("motm/**", lambda query: query.reply("motm/**", b"false"))
        for _ in range(5):
            for key in ("motm/**", "motm/*/*", "motm/frankie/*"):
                forger.put(key, b"false")
        answers = [client.query(name, b"") for name in COMMAND_NAMES[:3]]
        assert all(b"false" not in found for found in answers)
        assert client.events(0) is not None
        assert client.malformed == 0
        assert client.status().twin == "frankie"
        false.undeclare()


def test_what_is_put_on_a_wildcard_is_not_taken_for_the_robots(router, twin):
    plant = twin.external
    before = plant.link.unreadable
    for name in NAMES:
        router.session.put(f"motm/frankie/*/{name}", b"false")
    twin.advance()
    assert plant.link.unreadable == before


def test_the_twin_tells_what_its_robot_refuses_and_who_speaks_in_its_name(router, robot, twin):
    """At a router without an access control."""
    plant = twin.external
    mine = robot.robot
    twin.advance()
    assert "refuses" not in plant.text()
    with open_member(router.endpoint, wait=5.0) as forger:
        forger.put(KEYS.command, forged(mine.life, plant._seq + 10**6, mine.time + 0.02))
        until(lambda: not robot._queue.empty() or mine._up._under_way)
        for _ in range(3):
            twin.advance()
    assert mine._guard.refused == 1
    assert "it refuses commands, 1 so far: number" in plant.text()
    assert "somebody else commands in this twin's name" in plant.text()
    assert mine._guard.commander == plant._sender
    assert mine._guard._acting.seq == plant._seq - 1 or mine._guard._acting.seq <= plant._seq


def test_silence_lasts_as_long_as_a_robot_is_waited_for():
    assert SILENCE <= GONE


def test_what_another_robot_says_on_the_same_keys_does_not_count_and_is_told(router, scene):
    """Each of its messages is one of the robot's own, with another life."""
    inside, keys = Twin(scene), PlantKeys()
    copies = {}

    def copied(sample):
        message = msgspec.json.decode(sample.payload.to_bytes())
        if message["life"] != "zz":
            copies[str(sample.key_expr)] = msgspec.json.encode(message | {"life": "zz"})

    spies = [router.session.declare_subscriber(getattr(keys, name), zenoh.handlers.Callback(copied)) for name in NAMES]
    with running_robot(router, scene), driven(router, scene) as outside:
        plant = outside.external
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


@pytest.fixture
def link(router):
    """A link to whatever robot there is."""
    found = RobotLink(router.session, "frankie", listen_only=True)
    yield found
    found.close()


def test_a_robot_that_comes_back_after_another_one_is_listened_to_again(router, link):
    key = PlantKeys("frankie").state
    with open_member(router.endpoint) as robot:

        def says(life):
            robot.put(key, msgspec.json.encode(STATE | {"life": life}))

        def heard(life):
            says(life)
            return link.newest("state") is not None and link.newest("state").life == life

        def follows(life):
            says(life)
            return link.successor == life

        until(lambda: heard("first"))
        for life in ("second", "first"):
            until(lambda life=life: follows(life))
            assert link.newest("state").life == link.life != life  # until the twin turns to it
            link.live(life)
            assert (link.newest("state").life, link.successor) == (life, "")
            until(lambda life=life: heard(life))


def test_somebody_else_in_the_silence_of_a_robot_does_not_take_its_place(router, scene):
    """The robot is asked who it is before anybody is believed to be its successor; the run goes on where it was."""
    inside = Twin(scene)
    with running_robot(router, scene) as robot, driven(router, scene) as outside:
        plant = outside.external
        for _ in range(5):
            assert same(inside.advance(), outside.advance())

        def follows():  # a robot with a shared clock is silent between two periods
            router.session.put(plant.link.keys.state, msgspec.json.encode(STATE | {"life": "zz"}))
            return plant.link.successor == "zz"

        until(follows)
        until(plant.ready)
        assert (plant.link.life, plant.link.successor) == (robot.robot.life, "")
        for _ in range(5):
            assert same(inside.advance(), outside.advance())
