"""A box appears before the moving base: it brakes with all it has, backs out, and goes round."""

import pytest
from shapely.geometry import Polygon
from twin_steps import advance, advance_until, caused, short

from motm_twin.control.targets import world_in_odometry
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import AddObstacle, RemoveBody
from motm_twin.model.geometry import rectangle, to_frame
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

SCENE = """
format: motm-scene/1
robot: frankie
tasks: [{drive_to: {x: 4.0, y: 0.0}}]
time_limit: 40
"""


def overlap(pose, box, footprint):
    """The base body is in a box that stands along the axes of the world."""
    body = Polygon(rectangle(pose, (footprint.length, footprint.width)))
    return body.intersects(Polygon(rectangle((*box.position[:2], box.yaw), box.size)))


@pytest.mark.parametrize(("method", "gap"), [("fast", 0.0), ("motm", 0.02), ("staa", -0.04)])
def test_a_base_that_touches_a_box_stops_within_its_stopping_distance_and_goes_round(tmp_path, method, gap):
    """It drove on through the box: what was inside the footprint counted as nothing."""
    path = tmp_path / "open_floor.yaml"
    path.write_text(SCENE)
    scene = load_scene(str(path), None, 0)
    base, footprint = scene.robot.base, scene.robot.footprint
    twin = Twin(scene, method=find_method(method))
    start = touching = 0.0
    said = set()
    while True:
        tick = twin.advance()
        x = tick.truth.pose[0]
        if tick.index == 40:
            start, front = x, x + 0.025 + 0.5 * footprint.length
            twin.post(AddObstacle(name="box", x=float(front + gap + 0.15), y=0.0, size=(0.3, 1.2, 1.0)))
        if tick.truth.obstacles and overlap(tick.truth.pose, tick.truth.obstacles[0], footprint):
            touching = max(touching, x - start)
        said.add(tick.plan.status)
        if tick.done or tick.time > 40.0:
            break
    speed = base.forward_speed
    assert 0.2 < touching < speed**2 / (2 * base.linear_acceleration) + speed * (0.05 + base.velocity_lag) + 0.02
    assert "escaping" in said
    assert tick.success
    itself = [contact for contact in tick.truth.contacts if contact.other.startswith("panda")]
    assert itself == []  # the arm folded its hand onto its forearm when it dodged


def with_a_box_on_its_hand(phase):
    """A twin in whose way a box is put where the hand is, once that is in this phase."""
    twin, tick = short(phase)
    x, y = to_frame(world_in_odometry(tick.observation), tick.arm[-1].reference[:2]).tolist()
    twin.post(AddObstacle(name="box", x=x, y=y, size=(0.3, 0.3, 1.2)))
    return twin


@pytest.mark.slow
def test_an_arm_in_a_box_stands_although_the_beams_on_the_box_flicker():
    """It went on, deeper into the box, whenever no point was inside the arm for a period."""
    twin = with_a_box_on_its_hand("release")
    done = [twin.advance().arm[-1].qp_status.split(":")[0] for _ in range(180)]
    stood = done[done.index("standing") :]
    assert len(stood) > 170
    assert set(stood) == {"standing"}


@pytest.mark.slow
@pytest.mark.parametrize(("phase", "job"), [("final", "picks"), ("lift", "places")])
def test_an_arm_into_which_a_box_is_put_stands_draws_back_and_goes_on(phase, job):
    """It went on with its pick inside the box."""
    twin = with_a_box_on_its_hand(phase)
    for status in ("standing", "withdrawing"):
        tick = advance_until(twin, lambda tick, status=status: tick.arm[-1].qp_status.startswith(status), 280)
    tick = advance(twin, 60)
    assert not caused(tick)
    assert getattr(tick.truth, job) == 0
    twin.post(RemoveBody(name="box"))
    tick = advance_until(twin, lambda tick: getattr(tick.truth, job) == 1, 1000)
    assert not caused(tick)
