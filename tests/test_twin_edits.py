"""What a person tells the twin while it runs: parameters, tasks, moved furniture; and what it can tell about itself."""

import numpy as np
import pytest
from twin_steps import BIN, SCENE, SHORT, advance, advance_until, caused, holding, short

from motm_twin.control.parameters import Parameters
from motm_twin.control.tuning import PARAMETERS, tuned
from motm_twin.methods.registry import FAST
from motm_twin.model.edits import (
    AddObstacle,
    Announce,
    InjectFault,
    InsertTask,
    MoveBody,
    MoveObject,
    MoveTask,
    RemoveBody,
    RemoveTask,
    SetParameter,
)
from motm_twin.model.geometry import from_frame
from motm_twin.model.scene import DriveTo, Pick, Place
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

BEGINS = dict(FAST.parameters)  # of a twin that is told nothing
FAR_DRIVE = DriveTo(point=(0.0, -1.0))


def occupied(world, x, y):
    column, row = ((np.array([x, y]) - world.origin) / world.resolution).astype(int)
    return bool(world.occupied[row, column])


def test_a_parameter_changes_the_parts_and_nothing_else_of_the_state():
    twin = Twin(SCENE)
    advance(twin, 30)
    before = twin.loop.manipulator.snapshot(), twin.loop.planner.snapshot()
    twin.post(SetParameter(name="xi", value=0.3))
    twin.post(SetParameter(name="next_weight", value=2))
    assert twin.parameters == BEGINS, "it waits for the next period"
    tick = twin.advance()
    assert [edit.name for edit in tick.edits] == ["xi", "next_weight"]
    assert twin.parameters == {**BEGINS, "xi": 0.3, "next_weight": 2.0}
    assert twin.loop.manipulator.parameters.avoidance.xi == 0.3
    assert twin.loop.planner.parameters.placement.next_weight == 2.0
    assert before[0].phase == twin.loop.manipulator.snapshot().phase
    assert np.linalg.norm(before[1]["placement"].goal - twin.loop.planner.snapshot()["placement"].goal) < 0.1


def test_without_any_weight_of_the_next_target_the_cheapest_place_is_chosen():
    """Zero times the infinite cost of a rejected candidate was no number, and was chosen."""
    twin = Twin(SCENE, parameters={"next_weight": 0.0})
    placement = twin.advance().placement
    assert np.array_equal(placement.cost, placement.cost_current)
    assert placement.chosen == int(np.argmin(placement.cost))


def test_the_same_value_again_rebuilds_nothing_and_none_goes_back_to_the_start():
    twin = Twin(SCENE, parameters={"k_A": 0.4, "xi": 0.6})
    assert twin.parameters == {**BEGINS, "k_A": 0.4}
    planner, manipulator = twin.loop.planner, twin.loop.manipulator
    twin.post(SetParameter(name="k_A", value=0.4))
    twin.post(SetParameter(name="bezier", value=True))
    twin.advance()
    assert twin.loop.planner is planner
    assert twin.loop.manipulator is manipulator
    twin.post(SetParameter(name="k_A", value=0.8))
    twin.advance()
    twin.post(SetParameter(name="k_A"))
    twin.advance()
    assert twin.parameters == {**BEGINS, "k_A": 0.4}


def test_every_parameter_reaches_its_part_in_the_next_period():
    """Passive safety, and the margin of driving by hand, had no effect until the run began anew."""
    twin = Twin(SCENE)
    twin.advance()
    for entry in PARAMETERS:
        other = {"number": entry.low, "switch": not entry.default, "choice": entry.choices[-1:]}[entry.kind]
        twin.post(SetParameter(name=entry.name, value=other[0] if isinstance(other, tuple) else other))
    twin.advance()
    wanted, loop = tuned(twin.parameters), twin.loop
    assert loop.planner.parameters == wanted.planning
    assert loop.manipulator.parameters == wanted.arm
    assert loop.monitor.parameters == wanted.monitor
    assert loop.sequence.limits == wanted.sequence
    assert loop.by_hand.margin == wanted.planning.staa.margin
    assert {entry.path[0] for entry in PARAMETERS} == {"planning", "arm", "monitor", "sequence"}


@pytest.mark.parametrize(
    "edit",
    [
        SetParameter(name="k_a", value=0.5),
        SetParameter(name="k_A", value=7.0),
        SetParameter(name="nothing"),
        SetParameter(name="bezier", value="off"),
        Announce(name="tabel"),
        InsertTask(tasks=(Pick(object="cube_F3"),)),
        RemoveTask(index=99),
        MoveTask(index=0, to=-1),
    ],
)
def test_a_refused_edit_changes_nothing(edit):
    twin = Twin(SCENE)
    twin.advance()
    before = twin.state_hash()
    with pytest.raises(ValueError, match=r"\w+"):
        twin.post(edit)
    assert twin.state_hash() == before
    assert twin.advance().edits == ()
    assert twin.edits == []


def test_a_wrong_start_parameter_is_refused():
    with pytest.raises(ValueError, match="out of range"):
        Twin(SCENE, parameters={"xi": 99.0})


@pytest.mark.parametrize("end", ["low", "high"])
def test_the_robot_works_at_both_ends_of_every_range(end):
    """Every number at once at an end of its range, and every switch the other way: it drives, and hits nothing."""
    values = {}
    for entry in PARAMETERS:
        if entry.kind == "number":
            values[entry.name] = getattr(entry, end)
        elif entry.kind == "switch":
            values[entry.name] = end == "high"
        else:
            values[entry.name] = entry.choices[0 if end == "low" else -1]
    twin = Twin(SCENE, parameters=values)
    tick = advance(twin, 150)
    assert not tick.truth.contacts
    assert not tick.truth.plant_faults


def test_queued_edits_of_the_task_list_are_checked_one_after_the_other():
    twin = Twin(SCENE)
    count = len(SCENE.tasks)
    twin.post(InsertTask(tasks=(FAR_DRIVE,), index=0))
    twin.post(RemoveTask(index=count))
    twin.post(MoveTask(index=0, to=count - 1))
    with pytest.raises(ValueError, match="no task"):
        twin.post(RemoveTask(index=count))
    tick = twin.advance()
    assert len(tick.tasks) == count - 1
    assert tick.tasks[-1].kind == "drive_to"
    assert tick.tasks[0].status == "active"


def test_a_drive_inserted_before_the_active_task_is_driven_at_once():
    twin = Twin(SCENE)
    advance(twin, 30)
    twin.post(InsertTask(tasks=(FAR_DRIVE,), index=0))
    tick = twin.advance()
    assert tick.placement.mode == "drive"
    tick = advance_until(twin, lambda tick: tick.tasks[0].status == "done")
    assert np.hypot(*(tick.truth.pose[:2] - FAR_DRIVE.point)) < 0.25


def test_a_delivery_added_after_the_end_is_worked_through_and_counted():
    twin, _ = short("release")
    tick = advance_until(twin, lambda tick: tick.done)
    assert tick.success
    spare = next(item.name for item in SHORT.objects if item.name != SHORT.tasks[0].object)
    twin.post(InsertTask(tasks=(Pick(object=spare), Place(bin="drop2"))))
    assert not twin.advance().done
    advance_until(twin, lambda tick: tick.done)
    tick = advance(twin, 40)
    assert tick.success
    assert tick.truth.places == 2


def test_an_object_in_a_bin_is_not_picked_until_somebody_takes_it_out():
    cube, box = SHORT.tasks[0].object, SHORT.tasks[1].bin
    twin, _ = short("release")
    advance_until(twin, lambda tick: tick.truth.places == 1)
    again = InsertTask(tasks=(Pick(object=cube), Place(bin=box)))
    with pytest.raises(ValueError, match=f"{cube} lies in {box}"):
        twin.post(again)
    twin.post(MoveObject(name=cube, x=3.65, y=1.47))
    twin.post(again)
    tick = twin.advance()
    believed = next(belief for belief in tick.beliefs if belief.name == cube)
    assert np.linalg.norm(believed.position[:2] - (3.65, 1.47)) < 0.05, "who points at a cube shows where it is"
    advance_until(twin, lambda tick: tick.truth.picks == 2)


def test_a_twin_of_given_parameter_objects_has_no_session():
    twin = Twin(SCENE, numbers=Parameters())
    with pytest.raises(ValueError, match="parameters="):
        twin.session()


def test_a_branch_goes_back_over_parameters_map_and_log():
    twin = Twin(SCENE)
    advance(twin, 20)
    saved, before = twin.snapshot(), twin.state_hash()
    twin.post(SetParameter(name="xi", value=0.2))
    twin.post(MoveBody(name="table", x=4.2, y=2.0))
    twin.post(Announce(name="table"))
    advance(twin, 20)
    later, after = twin.snapshot(), twin.state_hash()
    twin.post(SetParameter(name="xi", value=0.4))
    twin.restore(saved)
    assert (twin.state_hash(), twin.parameters, twin.edits, twin.index) == (before, BEGINS, [], 20)
    assert twin.advance().edits == ()
    twin.restore(later)
    assert (twin.state_hash(), twin.parameters, len(twin.edits)) == (after, {**BEGINS, "xi": 0.2}, 3)
    other = Twin(SCENE)
    other.restore(later)
    assert advance(other, 20).index == advance(twin, 20).index
    assert other.state_hash() == twin.state_hash()
    assert other.session().edits == twin.session().edits


def test_an_announced_table_takes_its_cubes_its_place_on_the_map_and_the_believed_objects_along():
    twin = Twin(SCENE)
    tick = advance(twin, 20)
    believed = {belief.name: belief.position for belief in tick.beliefs}
    turn, centre = 0.2, np.array([4.2, 1.77])
    twin.post(MoveBody(name="table", x=4.5, y=2.3, heading=turn))
    twin.advance()
    twin.post(Announce(name="table"))
    tick = twin.advance()
    moved = np.array([4.5, 2.3, turn])
    for belief in tick.beliefs:
        expected = from_frame(moved, believed[belief.name] - [*centre, 0.0])
        assert np.linalg.norm(belief.position[:2] - expected[:2]) < 0.05
    assert not occupied(tick.map, 3.2, 1.45), "where it stood is free at once"
    assert occupied(tick.map, 4.5, 2.3)
    tick = advance_until(twin, lambda tick: tick.truth.picks == 1)
    assert not caused(tick)


@pytest.mark.parametrize("fault", ["pose_jump", "odometry_jump"])
@pytest.mark.parametrize("told", ["announced", "listed"])
def test_a_wrong_report_of_the_place_moves_no_belief(fault, told):
    """The robot did not believe the report, but what a person told it was taken over at the reported place."""
    twin, cube = holding(), "cube_L"  # which was seen
    twin.post(InjectFault(fault=fault, amount=0.5, seconds=30.0))
    advance(twin, 5)
    at = next(body.position for body in twin.plant.truth().objects if body.name == cube)
    if told == "announced":
        twin.post(MoveBody(name="table", x=4.5, y=2.3))
        twin.advance()
        twin.post(Announce(name="table"))
    else:
        twin.post(MoveObject(name=cube, x=at[0] + 0.3, y=at[1]))
        twin.post(InsertTask(tasks=(Pick(object=cube), Place(bin=BIN))))
    tick = twin.advance()
    believed = next(belief.position for belief in tick.beliefs if belief.name == cube)
    true = next(body.position for body in tick.truth.objects if body.name == cube)
    assert np.linalg.norm(believed - true) < 0.15


def test_the_check_of_single_beams_follows_a_map_with_other_edges():
    twin = Twin(SCENE)
    advance(twin, 20)
    twin.post(RemoveBody(name="cabinet"))
    twin.advance()
    twin.post(Announce(name="cabinet"))
    advance(twin, 20)
    check = twin.loop.self_check
    assert len(check.snapshot().sector.gone) == check.outline.first[-1] < Twin(SCENE).loop.self_check.outline.first[-1]


def test_an_announced_bin_is_served_where_it_stands_now():
    twin = holding()
    twin.post(MoveBody(name="drop1_round_table", x=1.2, y=0.5))
    twin.advance()
    twin.post(Announce(name="drop1_round_table"))
    tick = advance_until(twin, lambda tick: tick.truth.places == 1, 900)
    assert not caused(tick)


def test_announcing_furniture_that_was_not_moved_changes_nothing():
    twin, other = Twin(SCENE), Twin(SCENE)
    twin.post(Announce(name="table"))
    advance(twin, 5)
    advance(other, 5)
    assert twin.state_hash() == other.state_hash()


def test_only_mapped_furniture_is_announced():
    twin = Twin(load_scene("exp1a", "trial1", 0))
    twin.post(AddObstacle(name="crate", x=2.0, y=-0.5))
    twin.advance()
    for name, word in (("crate", "only furniture"), ("box_1", "lidar only"), ("tabel", "table")):
        with pytest.raises(ValueError, match=word):
            twin.post(Announce(name=name))


def test_the_paths_behind_the_costs_of_a_candidate():
    twin = Twin(SCENE)
    assert twin.candidate_paths(0) is None, "nothing has been searched yet"
    assert twin.staa_path().shape == (0, 2)
    tick = advance(twin, 20)
    before = twin.state_hash()
    to_it, onward = twin.candidate_paths(tick.placement.chosen)
    pose = tick.placement.poses[tick.placement.chosen]
    assert np.linalg.norm(to_it[0] - tick.observation.pose[:2]) < 0.1
    assert np.linalg.norm(to_it[-1] - pose[:2]) < 0.2
    assert np.linalg.norm(onward[0] - pose[:2]) < 0.2
    assert np.linalg.norm(onward[-1] - to_it[-1]) > 1.0
    staa = twin.staa_path()
    assert np.linalg.norm(staa[-1] - tick.placement.goal[:2]) < 0.2
    rejected = next(i for i, why in enumerate(tick.placement.rejected) if why)
    for index in (rejected, -1, len(tick.placement.poses)):
        assert twin.candidate_paths(index) is None
    assert twin.state_hash() == before


def test_the_stages_of_a_period_add_up():
    now = iter(0.001 * i for i in range(10**9))
    tick = Twin(SCENE, clock=lambda: next(now)).advance()
    stages = dict(tick.stage_ms)
    whole, plant = stages.pop("period"), stages.pop("observe")
    assert set(stages) == {"map", "place", "plan", "arm", "monitor"}
    assert plant > 0.0
    assert whole == pytest.approx(sum(stages.values()))
