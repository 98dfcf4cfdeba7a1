"""The cards that explain the robot, plots and score; nothing from outside becomes markup."""

import math

import msgspec
import numpy as np
import pytest
from fake_twin import FakeTwin, fake_scene
from person import status, with_arm

from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import ContactMessage, EventMessage, ForcesMessage, GraspMessage, ScoreMessage, TaskMessage
from motm_twin.control.task_list import kind_of, name_of
from motm_twin.measures.published import published
from motm_twin.model.arm_kernels import manipulability
from motm_twin.model.joint_limits import READY
from motm_twin.model.profile import BaseLimits
from motm_twin.model.scene_file import load_scene
from motm_twin.ui.history import Part, Sample, sample
from motm_twin.ui.panel.drive_tab import in_hand as in_hand_of
from motm_twin.ui.panel.panel import status_card
from motm_twin.ui.panel.plots import number, plots, thinned
from motm_twin.ui.panel.score import progress, score_card, timing_card
from motm_twin.ui.panel.why_tab import (
    READY_MANIPULABILITY,
    arm_card,
    bands,
    candidate_card,
    events_card,
    forces_card,
    headline,
    legend,
    now_card,
    task_card,
)

EVIL = "<img src=x onerror=alert(1)>"
replace = msgspec.structs.replace


def test_a_base_that_stands_moves_neither_forwards_nor_backwards(driving):
    standing = replace(driving, robot=replace(driving.robot, twist=[-0.001, -0.004]))
    assert "base stands" in now_card(standing)
    assert "base drives at 0.40 m/s, turns left at 6&deg;/s" in now_card(driving)


def test_the_reference_of_manipulability_is_that_of_the_ready_pose(driving):
    assert pytest.approx(manipulability(np.array(READY)), abs=5e-5) == READY_MANIPULABILITY
    assert "100 % of the ready pose" in arm_card(with_arm(driving, manipulability=READY_MANIPULABILITY), {})


def test_regions_follow_the_parameters_in_force(driving):
    assert bands({}) == (0.25, 0.6, 0.6)
    assert bands({"d_s": 0.1, "d_i": 0.8, "xi": 1.0}) == (0.1, 0.8, 1.0)
    assert "no nearer than 0.1 m" in arm_card(driving, {"d_s": 0.1})


def test_a_damped_stop_is_red_and_told(driving):
    card = arm_card(
        with_arm(
            driving, program="damped stop", qp_status="damped stop: bounds cross", manipulability=None, slack=[None] * 6
        ),
        {},
    )
    assert "damped stop: bounds cross" in card
    assert "moves as wanted" not in card and ">stops<" in card


def test_events_are_newest_first_with_the_contacts_among_them(driving):
    contact = ContactMessage(
        time=2.0, body="base", other="temi", depth=0.0, closing_speed=0.1, other_speed=0.2, caused_by_robot=False,
        duration=0.1,
    )  # fmt: skip
    score = replace(driving.score, contacts=[contact])
    events = [EventMessage(time=t, kind="picked", text=f"picked at {t}") for t in (3.0, 1.0)]
    card = events_card(replace(driving, score=score), events)
    places = [card.index(part) for part in ("picked at 3", "base touched temi (not by the robot)", "picked at 1")]
    assert places == sorted(places)
    assert "nothing yet" in events_card(replace(driving, score=None), [])


def test_the_score_stands_beside_the_published_times_of_this_task_only(driving):
    exp1 = status(scene="exp1", variant="trial1", reference_tour=58.9)
    done = replace(driving, time=80.0, done=True, success=True)
    card = score_card(done, exp1)
    assert "85.6 s" in card
    assert "Paper, Table I" in card
    assert "-7 %" in card
    assert "1.36" in card
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


def part_of_fake():
    payload = msgspec.json.encode(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0))
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
    contact = ContactMessage(
        time=0.0, body=EVIL, other=EVIL, depth=0.0, closing_speed=0.0, other_speed=0.0, caused_by_robot=True,
        duration=0.0,
    )  # fmt: skip
    hostile = replace(
        with_arm(
            driving, phase=EVIL, reason=EVIL, qp_status=EVIL, program=EVIL, limiter=EVIL,
            active=[EVIL, f"elbow - {EVIL}"],
        ),
        tasks=tasks, placement=placement, stop_reason=EVIL, faults=[EVIL], task_index=0,
        plan=replace(driving.plan, status=EVIL, reason=EVIL),
        score=ScoreMessage(picks=0, places=0, drops=0, contacts=[contact], min_base_clearance=None,
                           min_arm_clearance=None, min_ee_obstacle=None, ee_obstacle=None),
    )  # fmt: skip
    pages = [
        headline(hostile),
        now_card(hostile),
        task_card(hostile),
        arm_card(hostile, {}),
        candidate_card(placement, 0),
        candidate_card(placement, None),
        events_card(hostile, [EventMessage(time=0.0, kind=EVIL, text=EVIL)]),
        now_card(replace(hostile, task_index=99)),
        status_card("error", None, EVIL),
    ]
    for page in pages:
        assert "<img" not in page
        assert "&lt;img" in page
    assert "<img" not in legend(placement)
    assert "<img" not in score_card(hostile, None)


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
    drive = TaskMessage(kind="drive_to", target="(1.50, -0.61)", status="waiting", attempts=0)
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
    assert "1.05" not in card(3.0)
    assert "by the rule of this method" in card(3.0)


def test_a_candidate_tells_its_costs_or_why_it_is_out(tick):
    placement = tick.placement
    chosen = candidate_card(placement, placement.chosen)
    assert "chosen" in chosen
    assert f", best of {sum(cost is not None for cost in placement.cost)}" in chosen
    assert f"Candidate no. {placement.chosen + 1} of {len(placement.poses)}" in chosen
    out = next(index for index, reason in enumerate(placement.rejected) if reason)
    assert "Not possible: collision with object table" in candidate_card(placement, out)
    assert "linear-gradient" in candidate_card(placement, None)


FORCES = ForcesMessage(
    fingers=[38.0, 40.0], external_torque=[0.0, -12.3, 0.0, 0.0, 0.0, 0.0, 0.0], torque_peaks=[25.0] * 7,
    phantoms=[3, 1], wrist=[9.0, 0.4], wrist_peaks=[14.0, 0.9],
    grasp=GraspMessage(
        object=EVIL, time=3.0, firm=0.78, shift=0.0011, speed=0.021, slip=0.0004, lost=False
    ),
)  # fmt: skip


def test_forces_stand_beside_the_thresholds_of_the_reflex(driving):
    assert forces_card(driving) == ""
    card = forces_card(replace(driving, forces=FORCES))
    for said in ("38 N, 40 N", "joint 2: 12.3 Nm", "3 over 10 Nm, 1 over 20 Nm", "1.1 mm; slipped 0.4 mm", "0.78 s"):
        assert said in card
    assert EVIL not in card
    assert "lost" in forces_card(replace(driving, forces=replace(FORCES, grasp=replace(FORCES.grasp, lost=True))))


def test_forces_are_plotted_where_there_are_some():
    felt = rows(40, left=40.0, right=39.0, torque=12.0, wrist=8.0)
    found = plots(felt, BaseLimits(), {})
    assert len(found) == 9
    assert [plot.now for plot in found[6:]] == ["40, 39", "12.0", "8.0"]
    payload = msgspec.json.encode(replace(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0), forces=FORCES))
    taken = sample(msgspec.json.decode(payload, type=Part))
    assert (taken.left, taken.right, taken.torque, taken.wrist) == (38.0, 40.0, 12.3, 9.0)
