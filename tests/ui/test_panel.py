"""The panel and its hub without a browser: who drives, names, the list of tasks, looking back, file names."""

import asyncio
import time
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from page import until
from person import Client, Page
from person import status as of_server

from motm_twin.bus.commands import NAME_MAX, Answer, HandOver, Load, MoveTask, Pause, Play, TakeWheel
from motm_twin.bus.messages import TaskMessage
from motm_twin.ui.history import Playback, Span
from motm_twin.ui.hub import Hub, View, clean_name
from motm_twin.ui.panel import widgets
from motm_twin.ui.panel.disturb import Thing, about, faults
from motm_twin.ui.panel.drive_tab import TaskBlock, ended_lines, jobs, label, moved
from motm_twin.ui.panel.panel import asked_line, driver_line, status_card
from motm_twin.ui.panel.replay_tab import file_name, rerun_text
from motm_twin.ui.panel.widgets import HOLD, Block, follow

HOSTILE = '<img src=x onerror="alert(1)">&"\''
SPAN = Span(100, 500, 5.0, 25.0)


def status(driver="", name="", **changes):
    return of_server(driver=driver, driver_name=name, **{"time": 12.34, **changes})


def task(kind, target, state="waiting", attempts=0):
    return TaskMessage(kind=kind, target=target, status=state, attempts=attempts)


@pytest.fixture
def hub():
    made = Hub(Client())
    made.client.now = status("", "Ann")
    yield made
    made.stop()


class TestNames:
    @given(st.text(max_size=200))
    def test_a_name_is_printable_short_and_one_line(self, text):
        name = clean_name(text)
        assert len(name) <= NAME_MAX and name.isprintable() and name == name.strip()

    def test_signs_that_turn_the_direction_of_writing_are_left_out(self):
        assert clean_name("An\u202en\n\tSmith\x00") == "An n Smith"

    def test_an_empty_name_changes_nothing(self, hub):
        visitor = hub.enter(Page())
        visitor.rename("  \n ")
        assert visitor.name == "Visitor 1"
        visitor.rename("Ann")
        assert visitor.name == "Ann"

    def test_texts_from_outside_are_escaped(self):
        done = jobs([task("pick", HOSTILE, "done"), task("place", HOSTILE, "done")])
        texts = driver_line(status("x", HOSTILE), "me"), asked_line(HOSTILE), about(None, HOSTILE), faults([HOSTILE])
        file = rerun_text(file_name(status(scene=HOSTILE, variant=HOSTILE), "json"))
        for text in (*texts, about(Thing(HOSTILE, "agent"), HOSTILE), ended_lines(done), file):
            assert "<img" not in text


def test_notes_do_not_pile_up_and_the_same_is_not_shown_twice(hub):
    page = Page()
    visitor = hub.enter(page)
    for text in ("one", "one", "two", "three"):
        hub.tell(visitor, text)
    assert page.notes == ["one", "one", "two", "three"]
    assert page.removed == ["one", "one"]
    hub.tell(visitor, "two")
    assert page.removed == ["one", "one", "two"]


def test_a_long_list_of_tasks_has_a_dozen_rows_and_says_how_many_more_there_are(server):
    """A hundred rows of buttons made the page too slow to close its card."""
    block = TaskBlock(server.gui, SimpleNamespace(driving=lambda act: act), None)
    for count, rows, more in ((99, 12, "and 87 more"), (12, 12, ""), (3, 3, "")):
        block._show(jobs([task("drive_to", f"place {k}") for k in range(count)]))
        assert sum(row.visible for row in block._rows) == rows
        assert more in block._more.content and bool(block._more.content) == bool(more)


def test_rows_of_buttons_turn_grey_too(server):
    block = Block(server.gui, SimpleNamespace(driving=lambda act: act), None)
    row, button = block.row(("a", "b"), print), block.button("c", print)
    sent = []
    row._queue_update = lambda name, value: sent.append((name, value))
    for on in (False, False, True):
        block.enable(on)
        assert button.disabled is not on
    assert sent == [("disabled", True), ("disabled", False)]
    block.enable(False)
    assert block.row(("d",), print)._impl.props.disabled


class TestWheel:
    def test_the_line_says_who_drives(self):
        for driver, words in (("", "Nobody"), ("me", "You"), ("other", "Ann")):
            assert words in driver_line(status(driver, "Ann"), "me")

    def test_a_viewer_is_refused_in_the_callback_and_told_who_drives(self, hub):
        visitor, acted = hub.enter(Page(number=3)), []
        hub.client.now = status("somebody", "Ann")
        run(hub.driving(lambda *_: acted.append(1)), visitor)
        assert acted == [] and visitor.client.notes == ["Ann is driving"]

    def test_an_error_in_a_callback_is_told_on_the_page(self, hub):
        visitor = hub.enter(Page(number=3))
        run(hub.watching(lambda *_: 1 / 0), visitor)
        assert "ZeroDivisionError" in visitor.client.notes[0]

    def test_what_a_driver_does_on_the_page_alone_keeps_the_wheel(self, hub):
        visitor = hub.enter(Page(number=1))
        run(hub.driving(lambda *_: None), visitor)
        hub.client.arrived.acquire(timeout=5.0)
        assert [type(command) for command, *_ in hub.client.told] == [TakeWheel]
        run(hub.driving(lambda *_: None), visitor)  # at once again: kept already
        run(hub.driving(lambda *_: hub.send(visitor, Pause())), visitor)
        hub.client.arrived.acquire(timeout=5.0)
        assert [type(command) for command, *_ in hub.client.told] == [TakeWheel, Pause]

    def test_a_driver_that_vanishes_gives_the_wheel_back_and_says_no_more(self, hub):
        page = Page(number=1)
        visitor = hub.enter(page)
        hub.client.now, hub.view.at = status(visitor.sender, "Ann"), 7
        hub.leave(page)
        hub.client.arrived.acquire(timeout=5.0)
        assert hub.client.told == [(HandOver(), visitor.sender, visitor.name)]
        assert not hub.command(visitor, Pause()).ok
        assert len(hub.client.told) == 1 and hub.view.at is None and hub.visitors == []

    def test_what_holds_for_any_scene_waits_while_one_is_loaded_and_nothing_else_says_the_server_is_silent(self, hub):
        visitor, client = hub.enter(Page(number=1)), hub.client
        client.now = status(state="loading", text="loading exp2")
        client.answer = Answer(ok=False, reason="the twin server does not answer")
        assert not hub.command(visitor, MoveTask(index=1, to=0)).ok
        assert visitor.client.notes == ["still loading exp2: try again when it runs"]
        hub.send(visitor, Play())
        until(lambda: "comes next" in visitor.client.notes[-1])
        hub.send(visitor, Load(scene="exp1"))
        assert not any(isinstance(command, Load | Play) for command, *_ in client.told)
        client.answer = Answer(ok=True)
        client.now = status()
        until(lambda: client.told[-1][0] == Load(scene="exp1"))
        client.answer = Answer(ok=False, reason="the twin server does not answer")
        hub.command(visitor, Pause())
        assert visitor.client.notes[-1] == "the twin server does not answer"

    def test_who_asks_first_is_served_first_and_forgotten_when_gone(self, hub):
        pages = [Page(number=number) for number in range(3)]
        driver, ann, bob = (hub.enter(page) for page in pages)
        hub.client.now = status(driver.sender, "Ann")
        hub.ask(bob)
        hub.ask(ann)
        assert hub.asker() is bob and hub.asks(bob) and pages[0].notes
        hub.leave(pages[2])
        assert hub.asker() is ann
        hub.client.now = status(ann.sender, "Ann")
        assert hub.asker() is None


def run(callback, visitor):
    """Trigger a callback as Viser does."""
    asyncio.run(callback(SimpleNamespace(client_id=visitor.client.client_id)))


class TestTasks:
    LIST = (
        task("pick", "a", "done", 1), task("place", "x", "done", 1),
        task("pick", "b", "done", 2), task("place", "y", "active", 1),
        task("drive_to", "(1.00, 2.00)"),
        task("pick", "c"), task("drive_to", "(0.00, 0.00)"), task("place", "x"),
        task("pick", "d"),
    )  # fmt: skip

    def test_a_pick_belongs_to_its_place(self):
        listed = jobs(self.LIST)
        assert [(job.first, job.count, job.status) for job in listed] == [
            (0, 2, "done"), (2, 2, "active"), (4, 1, "waiting"), (5, 3, "waiting"), (8, 1, "waiting"),
        ]  # fmt: skip
        assert label(listed[1]) == "▶ b → y (try 2)"
        assert listed[3].text == "c → drive to (0.00, 0.00) → x"

    def test_a_drive_that_is_given_up_between_pick_and_place_leaves_the_delivery_as_it_is(self):
        pick, drive = task("pick", "a", "done", 1), task("drive_to", "(1.00, 2.00)", "failed")
        (under_way,) = jobs((pick, drive, task("place", "x", "active")))
        assert under_way.status == "active" and under_way.text == "a → drive to (1.00, 2.00) (given up) → x"
        assert under_way.now == 2
        assert jobs((pick, drive, task("place", "x", "done", 1)))[0].status == "done"
        assert jobs((pick, task("place", "x", "failed", 1)))[0].status == "failed"
        assert jobs((drive,))[0].status == "failed"

    def test_up_and_down_move_past_the_whole_neighbour(self):
        listed = jobs(self.LIST)
        assert moved(listed, listed[3], up=True) == MoveTask(index=5, to=4)
        assert moved(listed, listed[2], up=False) == MoveTask(index=4, to=8)
        assert moved(listed, listed[4], up=False) is None
        assert moved(listed, listed[1], up=True) is None, "what has ended stays before it"
        assert moved(listed[:2], listed[4], up=True) is None, "it is gone"

    def test_of_a_job_that_has_begun_the_rest_is_moved_and_removed(self):
        begun = jobs((task("pick", "a", "done", 1), task("drive_to", "(1.00, 2.00)", "active"), task("place", "x")))
        assert (begun[0].first, begun[0].now) == (0, 1)
        more = jobs((*self.LIST[2:4], *self.LIST[5:8]))
        assert moved(more, more[1], up=True) == MoveTask(index=2, to=1)

    @given(st.lists(st.tuples(st.sampled_from(["pick", "place", "drive_to"]), st.sampled_from("wad")), max_size=60))
    def test_every_task_is_in_one_job(self, kinds):
        tasks = [task(kind, "t", {"w": "waiting", "a": "active", "d": "done"}[state]) for kind, state in kinds]
        listed = jobs(tasks)
        covered = [index for job in listed for index in range(job.first, job.first + job.count)]
        assert covered == list(range(len(tasks)))


class TestLookingBack:
    @pytest.fixture
    def view(self):
        return View()

    @pytest.fixture
    def playback(self, view):
        return Playback(view)

    def test_seconds_before_now_choose_the_period(self, view, playback):
        for seconds, at in ((2.0, 460), (1000.0, SPAN.first), (0.0, None)):
            playback.look(seconds, SPAN)
            assert view.at == at

    def test_steps_end_at_the_newest_period(self, view, playback):
        for step, at in ((-1, 499), (1, None)):
            playback.step(step, SPAN)
            assert view.at == at

    def test_it_plays_at_its_speed_until_it_is_live(self, view, playback):
        view.at = 400
        playback.play(2.0, SPAN)
        start = playback._last
        for seconds, at in ((1.0, 440), (3.0, None)):
            playback.advance(SPAN, start + seconds)
            assert (view.at, playback.playing) == (at, at is not None)

    def test_what_is_forgotten_meanwhile_is_skipped(self, view, playback):
        view.at = 100
        playback.play(1.0, SPAN)
        playback.advance(SPAN._replace(first=300), playback._last + 0.06)
        assert view.at == 301

    def test_from_live_it_plays_all_there_is_and_without_a_history_nothing(self, view, playback):
        playback.look(3.0, None)
        playback.step(-1, None)
        playback.play(1.0, None)
        playback.advance(None, time.monotonic())
        assert view.at is None and not playback.playing
        playback.play(1.0, SPAN)
        assert view.at == SPAN.first


def test_files_have_names_that_any_system_takes_with_the_time_of_the_moment():
    assert file_name(status(), "json") == "exp2-random-0-12.3s.json"
    assert file_name(status(variant=""), "png") == "exp2-0-12.3s.png"
    assert file_name(status(scene="../../etc/passwd", variant="a b\n"), "json") == "etc_passwd-a_b-0-12.3s.json"
    assert file_name(None, "html") == "twin.html"
    assert file_name(status(), "png", looked_at=4.25) == "exp2-random-0-4.25s.png"


def test_the_headline_shows_the_time_that_is_looked_at():
    now, back = (status_card("playing", status(), "", time=4.25, live=live) for live in (True, False))
    assert "4.25 s" in now and "Running" in now
    assert "4.25 s" in back and "Looking back" in back and "Running" not in back


def test_a_note_before_the_first_period_has_room_for_two_lines():
    words = "preparing the control loop (the first start compiles it, a minute or more)"
    assert f'<div class="long" style="color:var(--motm-amber)">{words}</div>' in status_card("loading", status(), words)
    assert 'class="alert"' in status_card("playing", status(), words, says="<div>Driving to cube_F1.</div>")


def test_the_speed_is_what_was_asked_for_and_what_it_is_when_that_differs():
    wanted, differs = "8&times;<", "8&times;, in fact 3.10&times;<"
    for actual, capped, shown in ((0.0, 0, wanted), (7.9, 0, wanted), (3.1, 0, differs), (3.1, 1, "(all it can)")):
        now = status(speed=8.0, actual_speed=actual, capped=bool(capped))
        assert shown in status_card("playing", now, "", time=4.25)


class Box:
    """A widget that viser keeps the time of."""

    def __init__(self):
        self.value, self._impl = True, SimpleNamespace(update_timestamp=0.0)

    update_timestamp = property(lambda self: self._impl.update_timestamp)


@pytest.fixture
def box():
    return Box()


def test_what_a_person_has_just_chosen_is_not_set_back(box, monkeypatch):
    """Viser has set the new value and not called back yet: the program still wants the old one."""
    now = time.time()
    box.value, box._impl.update_timestamp = False, now
    follow(box, True)
    assert box.value is False
    monkeypatch.setattr(widgets, "time", SimpleNamespace(time=lambda: now + HOLD + 0.1))
    follow(box, True)  # nobody took it over: it was refused, say
    assert box.value is True


def test_what_others_choose_is_followed_at_once(box):
    follow(box, False)
    follow(box, True)
    assert (box.value, box.update_timestamp) == (True, 0.0)
