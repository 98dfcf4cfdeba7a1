"""The robot's doings in words and cards, plots and score; nothing from outside becomes markup."""

import math

import msgspec
import numpy as np
import pytest
from fake_twin import FakeTwin, fake_scene
from person import in_hand, status, with_arm

from motm_twin.bus import messages as bus
from motm_twin.bus.encode import tick_message
from motm_twin.control.arm.bodies import BODIES
from motm_twin.control.arm.controller import _BOUND_NAMES
from motm_twin.control.task_list import kind_of, name_of
from motm_twin.measures.references import published
from motm_twin.model.arm_kernels import manipulability
from motm_twin.model.profile import DQ_MAX, READY, BaseLimits
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.ui.history import Part, Sample, sample
from motm_twin.ui.panel import explain, why_tab
from motm_twin.ui.panel.drive_tab import in_hand as in_hand_of
from motm_twin.ui.panel.explain import avoided, gripper, limited_by, unmapped
from motm_twin.ui.panel.numbers import number, plots, progress, score_card, thinned, timing_card
from motm_twin.ui.panel.panel import status_card
from motm_twin.ui.panel.why_tab import arm_card, candidate_card, events_card, forces_card, headline, now_card, task_card

EVIL = "<img src=x onerror=alert(1)>"
replace = msgspec.structs.replace


def test_a_base_that_stands_moves_neither_forwards_nor_backwards(driving):
    standing = replace(driving, robot=replace(driving.robot, twist=[-0.001, -0.004]))
    assert "base stands" in now_card(standing)
    assert "base drives at 0.40 m/s, turns left at 6&deg;/s" in now_card(driving)


def test_the_reference_of_manipulability_is_that_of_the_ready_pose(driving):
    assert pytest.approx(manipulability(np.array(READY)), abs=5e-5) == why_tab.READY_MANIPULABILITY
    assert "100 % of the ready pose" in arm_card(with_arm(driving, manipulability=why_tab.READY_MANIPULABILITY), {})


def test_regions_follow_the_parameters_in_force(driving):
    assert why_tab.bands({}) == (0.25, 0.6, 0.6)
    assert why_tab.bands({"d_s": 0.1, "d_i": 0.8, "xi": 1.0}) == (0.1, 0.8, 1.0)
    assert "no nearer than 0.1 m" in arm_card(driving, {"d_s": 0.1})


def test_a_damped_stop_is_red_and_told(driving):
    said = {"program": "damped stop", "qp_status": "damped stop: bounds cross"}
    card = arm_card(with_arm(driving, **said, manipulability=None, slack=[None] * 6), {})
    assert "damped stop: bounds cross" in card
    assert "moves as wanted" not in card and ">stops<" in card


def contact(time, body, other, ours):
    return bus.ContactMessage(
        time=time, body=body, other=other, depth=0.0, closing_speed=0.1, other_speed=0.2, caused_by_robot=ours,
        duration=0.1,
    )  # fmt: skip


def test_events_are_newest_first_with_the_contacts_among_them(driving):
    score = replace(driving.score, contacts=[contact(2.0, "base", "temi", False)])
    events = [bus.EventMessage(time=t, kind="picked", text=f"picked at {t}") for t in (3.0, 1.0)]
    card = events_card(replace(driving, score=score), events)
    places = [card.index(part) for part in ("picked at 3", "base touched temi (not by the robot)", "picked at 1")]
    assert places == sorted(places)
    assert "nothing yet" in events_card(replace(driving, score=None), [])


def test_the_score_stands_beside_the_published_times_of_this_task_only(driving):
    exp1 = status(scene="exp1", variant="trial1", reference_tour=58.9)
    done = replace(driving, time=80.0, done=True, success=True)
    card = score_card(done, exp1)
    assert all(words in card for words in ("85.6 s", "Paper, Table I", "-7 %", "1.36"))
    assert "no published time" in score_card(done, replace(exp1, scene="playground"))
    assert "reference tour" not in score_card(done, replace(exp1, reference_tour=None))
    ended = score_card(replace(done, time=82.0, ended=80.0), exp1)
    assert "80.00 s" in ended and "-7 %" in ended and "1.36" in ended, "the 2 s after the end count"
    scene = load_scene("exp1", "trial1")
    tasks = [replace(driving.tasks[0], kind=kind_of(task), target=name_of(task)) for task in scene.tasks]
    assert "85.6 s" in score_card(replace(done, tasks=tasks), exp1, scene)
    less = score_card(replace(done, tasks=tasks[:2]), exp1, scene)
    assert "85.6" not in less and "reference tour" not in less and "the task list was changed" in less
    assert [entry.seconds for entry in published("exp1", "trial2")] == [95.9, 100.4, 172.3]


def rows(count, **columns):
    table = np.tile(sample(part_of_fake()), (count, 1))
    table[:, 0] = 0.05 * np.arange(count)
    for name, values in columns.items():
        table[:, Sample._fields.index(name)] = values
    return table


def part_of_fake(**changes):
    payload = msgspec.json.encode(replace(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0), **changes))
    return msgspec.json.decode(payload, type=Part)


def test_overruns_are_counted_against_the_budget():
    period = np.full(200, 12.0)
    period[:3] = 61.0
    card = timing_card(rows(200, period=period, map=3.0, plan=6.0, arm=3.0))
    assert "3 of 200 over 50 ms" in card and "Computing, last 10 s" in card
    assert "<b>61.0</b>" in card
    assert "no period yet" in timing_card(rows(0))


def test_a_curve_keeps_the_worst_of_what_it_leaves_out():
    table = rows(1200, distance=1.0, speed=0.2, period=9.0)
    fields = Sample._fields.index
    table[603, fields("distance")], table[604, fields("period")] = 0.0, 70.0  # one period only
    table[800:900, fields("distance")] = math.nan
    thin = thinned(table)
    assert len(thin) == 120
    assert np.nanmin(thin[:, fields("distance")]) == 0.0 and thin[:, fields("period")].max() == 70.0
    assert np.isnan(thin[:, fields("distance")]).sum() == 10
    assert np.isin(thin[:, 0], table[:, 0]).all()


def test_plots_take_everything_a_run_may_bring():
    for table in (rows(1), rows(2400), rows(5, distance=math.nan, linear_slack=math.nan, angular_slack=math.nan),
                  rows(5, period=math.nan, dq1=math.nan)):  # fmt: skip
        thin = thinned(table)
        found = plots(thin, BaseLimits(), {"d_s": 0.2})
        assert len(found) == 6 and sum(len(plot.data(thin[:, 0])) * len(thin) * 8 for plot in found) < 60_000
        assert all(len(values) == len(thin) for plot in found for values in plot.data(thin[:, 0]))
        assert "nan" not in "".join(plot.heading for plot in found)
        assert found[0].regions[0][0] == 0.2


def test_nothing_near_is_drawn_far_away():
    (near, *_) = plots(rows(9, distance=0.4), BaseLimits(), {})
    (none, *_) = plots(rows(9, distance=math.nan), BaseLimits(), {})
    assert near.now == "0.40" and none.now == "none near"
    assert near.data(np.zeros(9))[1].max() == 0.4 and none.data(np.zeros(9))[1].min() > near.range[1]


@pytest.mark.parametrize(
    ("value", "form", "shown"),
    [(-0.001, "+.2f", "0.00"), (0.0, "+.0f", "0"), (-0.4, ".0f", "0"), (-92.0, "+.0f", "&minus;92"),
     (0.46, "+.2f", "+0.46"), (math.nan, ".1f", "")],
)  # fmt: skip
def test_zero_has_no_sign_and_minus_is_a_true_one(value, form, shown):
    assert number(value, form) == shown


def test_names_from_outside_are_escaped_on_every_card(driving):
    tasks = [replace(task, target=EVIL, kind=EVIL, status=EVIL) for task in driving.tasks]
    placement = replace(driving.placement, rejected=[EVIL] * 72, mode=EVIL, reason=EVIL)
    hostile = replace(
        with_arm(
            driving, phase=EVIL, reason=EVIL, qp_status=EVIL, program=EVIL, limiter=EVIL,
            active=[EVIL, f"elbow - {EVIL}"],
        ),
        tasks=tasks, placement=placement, stop_reason=EVIL, faults=[EVIL], task_index=0,
        plan=replace(driving.plan, status=EVIL, reason=EVIL),
        score=replace(driving.score, contacts=[contact(0.0, EVIL, EVIL, True)]),
    )  # fmt: skip
    events = events_card(hostile, [bus.EventMessage(time=0.0, kind=EVIL, text=EVIL)])
    pages = [*(card(hostile) for card in (headline, now_card, task_card)), arm_card(hostile, {}), events]
    pages += [candidate_card(placement, 0), candidate_card(placement, None), status_card("error", None, EVIL)]
    pages += [now_card(replace(hostile, task_index=99))]
    assert all("&lt;img" in page for page in pages)
    assert not any("<img" in page for page in (*pages, why_tab.legend(placement), score_card(hostile, None)))


def test_a_finished_run_stands_beside_the_published_times_and_says_its_end_once(driving):
    ended = [replace(task, status="done") for task in driving.tasks]
    done = replace(
        driving, time=76.2, tasks=ended, task_index=len(ended), done=True, success=True,
        stop_reason="all 8 tasks are done",
        robot=replace(driving.robot, twist=[0.0, 0.0]),
    )  # fmt: skip
    assert (headline(done) + now_card(done)).lower().count("all 8 tasks are done") == 1
    assert "picked" in progress(driving, None) and "76.20 s" not in progress(driving, None)
    assert "76.20 s" in progress(done, None) and "no published time" in progress(done, None)


def test_where_time_stands_nothing_of_the_task_before_is_said_of_one_that_was_put_before_it(driving):
    before = replace(driving, plan=replace(driving.plan, time_to_range=1.5))
    assert "in 1.5 s" in now_card(before)
    drive = bus.TaskMessage(kind="drive_to", target="(1.50, -0.61)", status="waiting", attempts=0)
    put = replace(before, tasks=[drive, *driving.tasks], task_index=0, preview=True)
    assert "Driving to (1.50, -0.61)" in headline(put) and "target in reach" not in now_card(put)
    assert [task.status for task in in_hand_of(put)].index("active") == 0
    assert [task.status for task in in_hand_of(put)].count("active") == 1
    assert in_hand_of(before) == before.tasks


def test_a_cost_that_is_not_the_paper_s_sum_is_not_shown_as_one(driving):
    def card(total):
        one = {"cost_current": [2.0], "cost_next": [4.0], "cost": [total], "poses": [[0.0, 0.0, 0.0]]}
        return candidate_card(replace(driving.placement, **one, rejected=[""], chosen=0), 0, 1.05)

    assert "1.05 C_N" in card(6.2)
    assert "1.05" not in card(3.0) and "by the rule of this method" in card(3.0)


def test_a_candidate_tells_its_costs_or_why_it_is_out(tick):
    placement = tick.placement
    chosen, known = candidate_card(placement, placement.chosen), sum(cost is not None for cost in placement.cost)
    assert f", best of {known}" in chosen and "chosen" in chosen
    assert f"Candidate no. {placement.chosen + 1} of {len(placement.poses)}" in chosen
    out = next(index for index, reason in enumerate(placement.rejected) if reason)
    assert "Not possible: collision with object table" in candidate_card(placement, out)
    assert "linear-gradient" in candidate_card(placement, None)


FORCES = bus.ForcesMessage(
    fingers=[38.0, 40.0], external_torque=[0.0, -12.3, 0.0, 0.0, 0.0, 0.0, 0.0], torque_peaks=[25.0] * 7,
    phantoms=[3, 1], wrist=[9.0, 0.4], wrist_peaks=[14.0, 0.9],
    grasp=bus.GraspMessage(object=EVIL, time=3.0, firm=0.78, shift=0.0011, speed=0.021, slip=0.0004, lost=False),
)  # fmt: skip


def test_forces_stand_beside_the_thresholds_of_the_reflex(driving):
    assert forces_card(driving) == ""
    card, words = forces_card(replace(driving, forces=FORCES)), ("38 N, 40 N", "joint 2: 12.3 Nm", "0.78 s")
    assert all(said in card for said in (*words, "3 over 10 Nm, 1 over 20 Nm", "1.1 mm; slipped 0.4 mm"))
    assert EVIL not in card
    assert "lost" in forces_card(replace(driving, forces=replace(FORCES, grasp=replace(FORCES.grasp, lost=True))))


def test_forces_are_plotted_where_there_are_some():
    felt = rows(40, left=40.0, right=39.0, torque=12.0, wrist=8.0)
    found = plots(felt, BaseLimits(), {})
    assert len(found) == 9
    assert [plot.now for plot in found[6:]] == ["40, 39", "12.0", "8.0"]
    taken = sample(part_of_fake(forces=FORCES))
    assert (taken.left, taken.right, taken.torque, taken.wrist) == (38.0, 40.0, 12.3, 9.0)


PHASES = ("stow", "transit", "final", "closing", "lift", "carry", "release", "retry")
SCENE = fake_scene()
LIMIT = {"active": ["lidar moving"], "limiter": "moving obstacle", "obstacle_distance": 0.4}


def test_the_sentence_tells_for_whom_the_robot_waits_and_on_which_side_it_passes(driving):
    here = driving.robot.true_pose[:2]
    walker = body("Ann", here[0] + 1.0, here[1], "person")
    tracks = [
        bus.TrackMessage(track=number, position=[here[0] + x, here[1]], velocity=[0.0, 0.5], radius=0.25,
                         position_sd=0.02, expected=[])
        for number, x in ((3, 1.05), (7, 2.5))
    ]  # fmt: skip
    met = replace(driving, agents=[walker], tracks=tracks)

    def said(tick, **plan):
        return avoided(replace(tick, plan=replace(tick.plan, **plan)), SCENE)

    def other(track, yields="", passes=""):
        return bus.EncounterMessage(
            track=track, yields=yields, passes=passes, time=1.0, gap=0.4, speed=0.5, courtesy=0.0, reason="",
            why=Reason(kind=Kind.KEEPS_CLEAR),
        )  # fmt: skip

    brakes = replace(met, why=Reason(kind=Kind.MEETS_MOVER, value=0.6, limit=0.5))
    assert said(brakes) == "braking for Ann"
    assert said(replace(brakes, robot=replace(met.robot, twist=[0.0, 0.0]))) == "waiting for Ann"
    assert said(met, why=Reason(kind=Kind.MAKES_WAY, value=0.5)) == "making way for Ann"
    assert said(met, encounters=[other(7, passes="behind")]) == "passing behind person 7"
    assert said(met, encounters=[other(3, passes="in front")]) == "passing in front of Ann"
    assert said(met, encounters=[other(3, yields="other")]) == "Ann gives way"
    assert said(met, encounters=[other(3, passes="in front"), other(7, yields="robot")]) == "giving way to person 7"
    late = replace(other(7, passes="behind"), time=6.0)  # much may change until then
    assert said(met, encounters=[late]) == said(met, encounters=[other(7)]) == said(met)


@pytest.mark.parametrize("kind", ["pick", "place"])
@pytest.mark.parametrize("phase", [*PHASES, "something new"])
def test_every_phase_has_a_sentence_about_its_target(driving, phase, kind):
    driving = with_arm(in_hand(driving, kind), phase=phase)
    target, said = driving.tasks[driving.task_index].target, explain.doing(driving)
    assert target in said or "cube1" in said


def test_the_sentence_tells_whether_the_base_moves(driving):
    reaching = with_arm(in_hand(driving, "pick"), phase="final")
    assert explain.doing(reaching) == "Closing in on cube1, on the move"
    still = replace(reaching, robot=replace(driving.robot, twist=[0.0, 0.0]))
    assert explain.doing(still) == "Closing in on cube1"
    assert explain.doing(with_arm(still, why=Reason(kind=Kind.WAITS_FOR_SIGHT, subject="cube1"))) == "Looking for cube1"
    carrying = with_arm(in_hand(driving, "place"), phase="carry")
    assert explain.doing(carrying) == "Carrying cube1 to drop1"


def test_the_end_tells_what_was_given_up(driving):
    done = [replace(task, status="done") for task in driving.tasks]
    ended = replace(driving, tasks=done, task_index=len(done), done=True, success=True)
    assert explain.doing(ended) == "All 8 tasks are done"
    failed = replace(ended, tasks=[replace(done[0], status="failed"), *done[1:]], success=False)
    assert explain.doing(failed) == "All tasks have ended; given up: pick cube1"
    assert explain.doing(replace(ended, tasks=[], task_index=0)) == "Nothing to do: the list of tasks is empty"


def test_what_holds_the_robot_up_is_told_once_with_numbers(driving):
    slowed = with_arm(driving, **LIMIT, allowed_approach=0.257)
    tries = [replace(driving.tasks[0], attempts=2), *driving.tasks[1:]]
    first, second, *_, last = explain.waiting(
        replace(slowed, stop_reason="braking: something", tasks=tries, task_index=0)
    )
    assert (first, last) == (("Braking: something", True), ("This is the second try at cube1", False))
    assert second == ("A moving obstacle is 0.40 m away: the gripper may approach at 0.26 m/s", False)
    retreat = with_arm(slowed, allowed_approach=-0.1)
    assert "backs off at 0.10 m/s or more" in explain.slowed_by(retreat.arm)
    assert explain.slowed_by(with_arm(slowed, active=[]).arm) == ""


def test_every_row_and_bound_of_the_arms_program_is_told_in_words(driving):
    """Also those that the furniture of any scene brings: its names come from the scene."""
    names = ["lidar static", "lidar moving", "lidar height", *_BOUND_NAMES]
    names += [f"{body} - {other}" for body in BODIES for other in ("lidar", "own base", "own column", "desk - left")]
    for name in names:
        ((what, by),) = explain.constraints(with_arm(driving, active=[name]).arm, READY)
        assert by != "at its limit" and " - " not in what
    assert explain.constraints(with_arm(driving, active=["brand new"]).arm, READY) == [("brand new", "at its limit")]


def test_rows_are_grouped_and_joints_tell_their_limit(driving):
    fast = DQ_MAX * [0, 1, 0, 0, 0, 0, 0]
    step = with_arm(
        driving, active=["joint 4", "joint 2", "joint 1", "joint 3", "elbow - desk", "wrist - desk"],
        joint_velocity=fast.tolist(),
    )  # fmt: skip
    q = np.array(READY)
    q[3] = -0.2
    assert explain.constraints(step.arm, q) == [
        ("joint 4", "near the end of its range"),
        ("joint 2", "at full speed"),
        ("joints 1, 3", "speeds up or brakes as fast as it may"),
        ("elbow, wrist", "kept off desk"),
    ]


def body(name, x, y, kind="temi"):
    return bus.BodyMessage(name=name, kind=kind, position=[x, y, 0.0], yaw=0.0, state="", size=[0.4, 0.4, 1.0])


@pytest.fixture
def straight(tick):
    """The robot drives along x from the origin; nothing is near."""
    robot = replace(tick.robot, true_pose=[0.0, 0.0, 0.0], twist=[0.4, 0.0])
    way = replace(tick.plan, status="goal", local_poses=[[x, 0.0, 0.0, 0.4, 0.0] for x in (0.3, 0.6, 0.9)])
    arm = [replace(step, active=[], limiter="") for step in tick.arm]
    return replace(tick, robot=robot, plan=way, arm=arm, agents=[], obstacles=[], stop_reason="", done=False)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((1.2, 0.2), "past temi 1, 0.7 m ahead"),
        ((0.5, 0.8), "past temi 1, 0.4 m to its left"),
        ((0.5, -0.8), "past temi 1, 0.4 m to its right"),
        ((-0.9, 0.0), ""),
        ((2.5, 0.0), ""),
    ],
)
def test_a_body_near_the_way_is_named_with_its_distance_and_side(straight, place, said):
    assert avoided(replace(straight, obstacles=[body("temi 1", *place)]), SCENE) == said


def test_the_kind_is_told_where_the_name_does_not(straight):
    assert "Ann (person)" in avoided(replace(straight, agents=[body("Ann", 1.2, 0.0, "person")]), SCENE)


def test_who_it_brakes_for_is_named_or_else_what_the_lidar_sees(straight):
    braking = replace(straight, why=Reason(kind=Kind.IN_STOPPING_WAY, subject="lidar", value=0.61, limit=0.7))
    assert avoided(braking, SCENE) == "braking for something the lidar sees 0.6 m away"
    braking = replace(braking, obstacles=[body("box 1", 1.1, 0.0, "box")])
    assert avoided(braking, SCENE) == "braking for box 1, 0.6 m ahead"
    still = replace(braking, robot=replace(braking.robot, twist=[0.0, 0.0]))
    assert avoided(still, SCENE) == "held up by box 1, 0.6 m ahead"
    waits = replace(still, why=Reason(kind=Kind.PHASE, subject="cube1", other="the fingers close"))
    assert avoided(waits, SCENE) == ""


def test_what_slows_the_gripper_is_named_when_it_is_as_far_as_the_lidar_says(straight):
    hand = gripper(straight, SCENE)
    near = body("temi 1", hand.x, hand.y + 0.6)
    slow = replace(with_arm(straight, allowed_approach=0.1, **LIMIT), obstacles=[near])
    assert avoided(slow, SCENE) == "keeping the gripper off temi 1 (0.4 m)"
    assert limited_by(slow, SCENE) == "temi 1"
    assert "temi 1 is 0.40 m away: the gripper may approach" in now_card(slow, SCENE)
    elsewhere = replace(slow, obstacles=[])
    assert "something that moves" in avoided(elsewhere, SCENE) and limited_by(elsewhere, SCENE) == ""


def test_furniture_that_was_moved_is_not_in_the_map_until_the_robot_is_told(straight):
    name = next(name for name, piece in pieces(SCENE).items() if piece.mapped)
    moved = replace(straight, furniture=[replace(body(name, 1.4, 0.0, "piece"), size=[1.0, 1.0, 1.0])])
    assert not [thing for thing in unmapped(straight, SCENE) if name in thing.label]
    assert f"past {name}, which is not where the map has it," in avoided(moved, SCENE)
    told = replace(moved, announced={name: [1.4, 0.0, 0.0]})  # by whomever
    assert avoided(told, SCENE) == ""
    again = replace(told, furniture=[replace(moved.furniture[0], position=[1.5, 0.0, 0.0])])
    assert name in avoided(again, SCENE)
    back = replace(told, furniture=[])
    assert [thing for thing in unmapped(back, SCENE) if name in thing.label], "the map has it where it no longer is"


def test_hostile_names_stay_text(straight):
    evil = "<img src=x onerror=alert(1)>"
    page = headline(replace(straight, obstacles=[body(evil, 1.2, 0.0)]), SCENE)
    assert "<img" not in page and "&lt;img" in page


def test_the_hand_is_where_the_kinematics_has_it(straight):
    turned = replace(straight, robot=replace(straight.robot, true_pose=[1.0, 2.0, np.pi]))
    first, second = gripper(straight, SCENE), gripper(turned, SCENE)
    assert (second.x, second.y) == pytest.approx((1.0 - first.x, 2.0 - first.y))
