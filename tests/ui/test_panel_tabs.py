"""A whole panel without a browser: its widgets are made, follow what is shown, and send what they should."""

import json
import math
from importlib.util import find_spec

import msgspec
import pytest
import viser
from person import Person, is_disabled, label, status

from motm_twin.bus import commands as to
from motm_twin.bus.encode import tick_message
from motm_twin.bus.library import MethodLibrary
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import FAST
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.twin import Twin
from motm_twin.ui.hub import BLIND, LAYERS, STAA, Shown
from motm_twin.ui.panel.panel import ASK, MARK
from motm_twin.ui.panel.why_tab import headline
from motm_twin.ui.scene.scene_view import SceneView


@pytest.fixture(scope="module")
def scene():
    return load_scene("exp2", "random", 0)


@pytest.fixture(scope="module")
def ticks(scene):
    twin = Twin(scene)
    return [tick_message(twin.advance(), run=1, server_time=0.0) for _ in range(30)]


@pytest.fixture
def person(server, scene, ticks):
    made = Person(server, scene, ticks)
    made.shows()
    yield made
    made.hub.stop()


def test_it_can_be_shown_before_there_is_a_twin(person):
    nothing = dict.fromkeys(("status", "scene", "tick", "newest"))
    person.panel.update(Shown(state="waiting", live=True, view=person.hub.view, **nothing))
    person.shows("lost")
    person.shows("done")
    assert person.page.notes == []


def test_what_the_robot_does_stands_above_the_tabs_and_nowhere_else(person):
    person.shows()
    said, page = headline(person.ticks[-1], person.scene), person.panel
    assert [html for html in texts(page) if 'class="big' in html.content] == [page._status]
    assert page._status.content.count(said) == 1


def texts(part, depth=3):
    """Every piece of HTML of a panel and of its parts."""
    parts = [*vars(part).values(), *vars(part).get("_blocks", [])]
    found = [value for value in parts if isinstance(value, viser.GuiHtmlHandle)]
    inner = [p for p in parts if depth and type(p).__module__.startswith("motm_twin.ui") and hasattr(p, "__dict__")]
    return found + [html for part in inner for html in texts(part, depth - 1)]


def test_a_run_that_has_ended_begins_anew_by_its_button_and_by_no_key_that_was_meant_to_pause_it(person):
    drive = person.panel._blocks[1]
    drive.toggle()
    assert person.sent == [to.Pause()]
    person.shows("done")
    drive.toggle()
    assert len(person.sent) == 1 and "start it again" in person.page.notes[-1]
    person.asks("toggle")
    assert person.sent == [to.Play()]
    person.shows("paused")
    drive.toggle()
    assert person.last == to.Play()


def test_another_scene_is_chosen_and_news_of_an_earlier_load_do_not_undo_what_a_person_chooses_next(person):
    person.chooses("Scene", "exp1")
    assert person.widget("Variant").options == ("trial1",)
    person.shows(variant="still")  # loaded before, heard of late
    assert (person.widget("Scene").value, person.widget("Variant").value) == ("exp1", "trial1")
    person.presses("Load")
    assert person.sent == [to.Load(scene="exp1", variant="trial1", seed=0, method=DEFAULT_METHOD)]
    person.shows(scene="exp2", variant="random", seed=3)  # somebody else was quicker
    assert [person.widget(name).value for name in ("Scene", "Variant", "Seed")] == ["exp2", "random", 3]
    person.chooses("Scene", "exp1")
    person.shows(driver="somebody", driver_name="Bob")
    assert person.widget("Scene").value == "exp2"  # who only looks sees what is loaded


def test_tasks_are_added_moved_and_removed(person):
    cube, box = person.scene.objects[1].name, person.scene.bins[0].name
    person.chooses("Cube", cube)
    person.chooses("Into bin", box)
    person.presses("Add to the tasks")
    assert isinstance(person.last, to.InsertTask) and len(person.last.tasks) == 2
    person.presses("▼", 1)
    assert person.sent == [to.MoveTask(index=2, to=6)]
    person.presses("✕", 2)
    assert person.sent == [to.RemoveTask(index=4)]


def test_bodies_are_added_and_the_selected_one_is_sent_and_deleted(person):
    person.presses("Temi")
    (added,) = person.client.heard
    assert isinstance(added, to.AddObstacle) and person.hub.view.selected == person.hub.view.placing == added.name
    assert f"{added.name} stands" in person.page.notes[-1]
    agent = person.selects(person.scene.agents[0].name)
    assert person.widget("Freeze").visible and not person.widget("Tell the robot").visible
    person.presses("Send to…")
    assert person.hub.view.sending == agent and not any(isinstance(c, to.SendAgent) for c in person.sent)
    person.shows()
    person.presses("Delete")
    assert person.last == to.RemoveBody(name=agent)


def test_people_and_temis_behave_as_it_is_chosen_for_the_selected_one(person):
    agent = person.scene.agents[0].name
    person.chooses("Selected", agent)
    person.widget("On its way")._impl.update_timestamp = 0.0  # nobody has just chosen
    bodies = [msgspec.structs.replace(body, behaviour="social_force") for body in person.ticks[-1].agents]
    person.shows(tick=msgspec.structs.replace(person.ticks[-1], agents=bodies))
    manner = person.widget("On its way")
    assert manner.visible and manner.value == "As the scene says"
    person.chooses("On its way", "As the scene says")
    assert person.sent == []
    person.chooses("On its way", "Stops for nobody")
    assert person.last == to.SetBehaviour(name=agent, behaviour="blind")
    assert ("Steers clear (ORCA)" in manner.options) == (find_spec("pyrvo") is not None)
    person.selects(next(iter(pieces(person.scene))))
    assert not manner.visible


def test_furniture_is_announced_and_cubes_are_put_elsewhere(person):
    piece = person.selects(next(iter(pieces(person.scene))))
    person.presses("Tell the robot")
    assert person.client.heard == [to.Announce(name=piece)] and piece in person.page.notes[-1]
    person.client.answer = to.Answer(ok=False, reason="no")
    person.presses("Tell the robot")
    assert person.page.notes[-1] == "no"
    cube = person.selects(person.scene.objects[0].name)
    person.presses("In front of the robot")
    assert isinstance(person.last, to.MoveObject) and person.last.name == cube
    assert not person.widget("Delete").visible


def test_the_robot_is_pushed_and_blinded(person):
    person.presses("◀ Left")
    assert isinstance(person.last, to.PushRobot) and math.hypot(person.last.dx, person.last.dy) == pytest.approx(0.1)
    person.presses("Camera off 2 s")
    assert person.last == to.InjectFault(fault="camera_off", seconds=2.0)
    person.shows(tick=msgspec.structs.replace(person.ticks[-1], faults=["camera off for 2 s"]))
    assert any("camera off for 2 s" in html.content for html in texts(person.panel))


def shows_with(person, bodies, name, state):
    """A next tick, with the state of one of the objects or agents changed."""
    newest = person.ticks[-1]
    changed = [msgspec.structs.replace(b, state=state) if b.name == name else b for b in getattr(newest, bodies)]
    tick = msgspec.structs.replace(newest, index=newest.index + 1, **{bodies: changed})
    person.hub.history.add(msgspec.json.encode(tick))
    person.shows(tick=tick)


def test_the_cube_is_taken_from_the_gripper_while_it_holds_one(person):
    take, cube = "Take the cube from the gripper", person.scene.objects[0]
    assert not person.widget(take).visible
    shows_with(person, "objects", cube.name, "held")
    assert person.widget(take).visible
    person.presses(take)
    assert person.last == to.MoveObject(name=cube.name, x=cube.position[0], y=cube.position[1])


def test_the_selected_agent_is_frozen_and_goes_on(person):
    agent = person.selects(person.scene.agents[0].name)
    person.presses("Freeze")
    assert person.last == to.FreezeBody(name=agent, frozen=True)
    shows_with(person, "agents", agent, "frozen")
    person.presses("Go on")
    assert person.last == to.FreezeBody(name=agent, frozen=False)


def test_sliders_send_and_follow(person):
    title = "Weight of the next target"
    person.chooses(title, 1.5)
    person.shows()
    assert person.last == to.SetParameter(name="next_weight", value=1.5)
    person.shows(parameters={"next_weight": 1.5, "xi": 1.0})
    assert person.widget("● Approach speed  xi [m/s]").value == 1.0
    assert person.widget("● " + title).value == 1.5


def test_as_shipped_means_the_method_that_drives_and_without_a_change_nothing_is_compared(person):
    fast = dict(FAST.parameters)
    person.shows(parameters=fast, method="fast", methods=MethodLibrary().choices())
    assert person.widget("Preset").value == "As shipped"
    offset = person.widget("Bezier control points")
    assert offset.value == 0.1 and "drives: 0.1" in offset._impl.props.hint
    assert [mark["value"] for mark in offset._impl.props._marks] == [0.1, 0.25]
    person.presses("Reset everything")
    person.shows()
    assert not any(isinstance(command, to.SetParameter) for command in person.sent)
    started = []
    person.hub.what_if.start = lambda values, *_: started.append(values)
    person.presses("Compare")
    assert "nothing is changed" in person.page.notes[-1] and started == []
    person.chooses("Approach speed  xi [m/s]", 1.0)
    person.shows(parameters={**fast, "xi": 1.0})
    person.chooses("Changed", "from now")
    person.presses("Compare")
    assert "the running twin has these values already" in person.page.notes[-1] and started == []
    person.chooses("Changed", "from the start")
    person.presses("Compare")
    assert started == [{"xi": 1.0}]


def test_what_is_refused_is_not_said_to_be_added_and_every_press_is_answered(person):
    no = "this is a recording"
    person.client.answer = to.Answer(ok=False, reason=no)
    for kind in ("Temi", "Box"):
        person.presses(kind)
        assert person.page.notes[-1] == no and not any("stands" in note for note in person.page.notes)
        assert (person.hub.view.selected, person.hub.view.placing) == ("", "")
    notes = len(person.page.notes)
    person.presses("▲")
    assert "is the first that is left already" in person.page.notes[-1]
    person.hub.send = person.hub.command  # as it comes from there
    person.presses("▼", 1)
    assert person.page.notes[notes + 1 :] == [no]


def test_nothing_is_changed_while_looking_back(person):
    person.asks("look", 0.5)
    assert person.hub.view.at == 19
    person.shows()
    for press in ("Temi", "✕", "◀ Left"):
        person.presses(press)
        assert all(not isinstance(c, to.RemoveTask | to.PushRobot) for c in person.sent) and person.client.heard == []
    assert len(person.page.notes) == 3 and "looking back" in person.page.notes[0]
    person.asks("branch")
    assert person.last == to.Branch(index=19) and person.hub.view.at is None


def test_a_branch_says_what_it_does_and_is_undone(person):
    assert overlaid(person, "now")["aside"] is None  # nothing to undo
    newest = msgspec.structs.replace(person.ticks[19], run=5, first=19, past=4)
    person.shows(tick=newest, aside=1.5)
    assert overlaid(person, "now")["aside"] == 1.5
    assert "goes on from 0.95 s" in person.page.notes[-1]
    person.shows(tick=newest)
    assert len(person.page.notes) == 1
    person.asks("undo")
    assert person.last == to.UndoBranch()
    person.shows(tick=msgspec.structs.replace(newest, run=6, first=30, past=4), aside=1.0)
    assert "as before the branch" in person.page.notes[-1]


def test_who_only_looks_has_grey_widgets_and_downloads_the_session(person):
    person.shows(driver="somebody", driver_name="Bob")
    person.presses("Save the session")
    assert person.page.files == [("exp2-random-0-1.0s.json", b"{}")]
    usable = {label(widget) for widget in person.widgets.values() if not is_disabled(widget)}
    assert len(person.widgets) - len(usable) > 50
    assert {"Ask for the wheel", "Your name", "Save the session"} <= usable
    person.shows(driver=person.visitor.sender)
    assert not person.widget("Load")._impl.props.disabled
    person.presses("Hand over")
    assert person.last == to.HandOver()


def test_what_does_not_change_is_not_sent_again(person):
    for _ in range(30):
        person.shows()
    queued = []
    person.widgets[next(iter(person.widgets))]._impl.gui_api._websock_interface.queue_message = queued.append
    for _ in range(20):
        person.shows()
    assert [message for message in queued if "Gui" in type(message).__name__] == []


def overlaid(person, mark):
    """Data for the script over the scene."""
    overlay, start = person.panel._blocks[-1], MARK.format(mark)
    contents = (getattr(overlay, f"_{name}").content for name in ("legend", "now", "events", "names"))
    return json.loads(next(content for content in contents if content.startswith(start)).removeprefix(start))


def test_the_timeline_knows_what_is_kept_and_the_legend_what_is_drawn(person, server):
    now = overlaid(person, "now")
    assert (now["state"], now["live"], now["mine"], now["t"]) == ("playing", True, True, 1.45)
    assert now["span"] == [0.0, 1.45]
    assert {layer["key"] for layer in overlaid(person, "legend")} == {layer.key for layer in LAYERS}
    SceneView(server, person.hub).stop()
    still = ("/scene", "/light", "/furniture")
    drawn = {f"{name}/" for name in server.scene._handle_from_node_name if not name.startswith(still)}
    for node in (node for layer in LAYERS for node in layer.nodes):
        assert node == "/map" or any(name.startswith(f"{node}/") for name in drawn), node
    assert [name for name, *_ in overlaid(person, "names")["bins"]] == [box.name for box in person.scene.bins]


def test_the_timeline_plays_steps_and_looks_back(person):
    person.client.status = lambda: person.status
    for command, *words in ((to.Pause(), "toggle"), (to.Speed(factor=0.25), "speed", "1/4"), (to.Step(), "step", 1)):
        person.asks(*words)
        assert person.last == command
    person.asks("step", -1)
    assert person.hub.view.at == 28 and person.sent == []
    person.shows()
    assert overlaid(person, "now")["live"] is False
    person.asks("toggle")  # the past, not the twin
    assert person.hub.playback.playing and person.sent == []
    person.asks("live")
    assert person.hub.view.at is None


def test_a_drive_is_proposed_confirmed_or_cancelled_and_the_last_one_undone(person):
    view, tick = person.hub.view, person.ticks[-1]
    view.going = (1.0, 2.0)
    person.shows()
    assert (overlaid(person, "now")["going"], overlaid(person, "now")["free"]) == ([1.0, 2.0], True)
    person.asks("go")
    assert person.drives == [1]
    person.asks("stay")
    assert view.going is None and person.sent == []
    view.sent_to = "(1.00, 2.00)"
    task = msgspec.structs.replace(tick.tasks[0], kind="drive_to", target=view.sent_to, status="active")
    person.shows(tick=msgspec.structs.replace(tick, tasks=[task, *tick.tasks], task_index=0))
    assert overlaid(person, "now")["sent_to"] == "Drive to (1.00, 2.00) has begun"
    person.asks("stay")
    assert person.last == to.RemoveTask(index=0)
    person.shows()
    assert overlaid(person, "now")["sent_to"] == "", "it has ended"


def test_a_link_chooses_the_camera_and_what_no_script_of_ours_would_ask_is_left(person):
    person.asks("camera", "Follow")
    assert person.cameras == ["Follow"]
    for words in ("", "no JSON", "[1]", '[1, "format"]', "{}", "[1, []]", "17"):
        person.chooses(ASK, words)
    assert person.sent == [] and person.page.notes == []


def test_who_only_looks_may_hide_layers_and_save_but_not_drive(person):
    person.shows(driver="somebody", driver_name="Bob")
    person.client.status = lambda: status(driver="somebody", driver_name="Bob")
    person.asks("hide", ["grid", STAA])
    assert person.visitor.hidden == {"grid", STAA} and not person.hub.shows(STAA)
    person.asks("hide", [])
    assert person.hub.shows(STAA)  # somebody wants to see it
    person.asks("toggle")
    assert person.sent == [] and "Bob" in person.page.notes[-1]


def test_a_page_counts_as_a_look_once_it_has_drawn(person):
    assert not person.visitor.looks
    person.asks("drawn")
    assert person.visitor.looks
    person.visitor.drawn, person.visitor.since = False, person.visitor.since - BLIND
    assert person.visitor.looks  # one without our script
