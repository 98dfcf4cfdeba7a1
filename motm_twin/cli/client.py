"""`motm-twin watch | twins | send | robot`: programs that connect to a twin.

They print messages, list running twins, send a command; or run the reference robot, our simulated plant with its
referee as a separate program.
"""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import msgspec
from tyro.conf import FlagCreatePairsOff, Positional, arg

from motm_twin.bus import commands
from motm_twin.cli.settings import Seed
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.names import hint
from motm_twin.program import BAD_INPUT, FAILED, OK, printable, write_json

if TYPE_CHECKING:
    from motm_twin.client.discover import Found
    from motm_twin.client.twin import Twin
    from motm_twin.external.robot_server import RobotServer

_Endpoint = Annotated[str | None, arg(metavar="ENDPOINT")]
_Name = Annotated[str | None, arg(metavar="NAME")]
_Json = Annotated[FlagCreatePairsOff[bool], arg(name="json")]
KEYS = ("tick", "robot", "scan", "grid", "event", "metrics", "status", "scene")
FIRST = 5.0  # [s] for the first message
_SLICE = 0.5  # [s]


def watch(
    key: Annotated[Positional[str], arg(metavar="[KEY]")] = "tick",
    /,
    once: FlagCreatePairsOff[bool] = False,
    json: _Json = False,
    field: Annotated[str | None, arg(metavar="PATH")] = None,
    endpoint: _Endpoint = None,
    twin: _Name = None,
) -> int:
    """Print what a running twin publishes, one line each, until Ctrl-C: the newest state, and every event.

    Exit code 0: ended; 1: no twin answers; 2: bad input.

    Args:
        key: One of tick, robot, scan, grid, event, metrics, status, scene.
        once: Print only the newest value.
        json: Print the messages themselves, as JSON.
        field: Print one field, as JSON; its path with dots: robot.pose.0.
        endpoint: Address of the twin server; without it, that of MOTM_ZENOH_CONFIG, or the twin on this machine.
        twin: Name of the twin.
    """
    from motm_twin.client.discover import OPTIONS, NoTwin, find
    from motm_twin.client.twin import Twin

    if key not in KEYS:
        print(f"motm-twin watch: there is no key {key!r}; there are: {', '.join(KEYS)}", file=sys.stderr)
        return BAD_INPUT
    try:
        with Twin(*find(endpoint, twin, how=OPTIONS)) as handle:
            for message in _messages(handle, key, once):
                line = _chosen(message, field) if field else _json(message) if json else _LINES[key](message)
                print(printable(line))
                sys.stdout.flush()
                if once:
                    break
    except KeyboardInterrupt:
        return OK
    except (NoTwin, TimeoutError) as error:
        print(f"motm-twin watch: {error}", file=sys.stderr)
        return FAILED
    except LookupError as error:
        print(f"motm-twin watch: {error.args[0]}", file=sys.stderr)
        return BAD_INPUT
    return OK


def _messages(handle: "Twin", key: str, once: bool) -> Iterator[dict[str, Any]]:
    """Newest messages of a key, or all events; for grids their attachments."""
    client, name = handle.client, getattr(handle.client.keys, key)
    if key == "event" and not once:
        for event in handle.events():
            yield msgspec.to_builtins(event)
        return
    client.follow(name)
    count = client.wait(name, 0, FIRST)
    if count == 0:
        raise TimeoutError(f"nothing came on {name} for {FIRST:g} s")
    while not client.closed:
        payload, attachment = client.raw(name)
        yield msgspec.json.decode((attachment or b"null") if key == "grid" else payload)
        while (now := client.wait(name, count, _SLICE)) == count and not client.closed:
            continue
        count = now


def _chosen(message: Any, path: str) -> str:
    """A field by its path. Raises LookupError."""
    for part in path.split("."):
        try:
            message = message[int(part)] if isinstance(message, list) else message[part]
        except (LookupError, TypeError, ValueError):
            parts = message if isinstance(message, dict) else ()
            known = f"0 to {len(message) - 1}" if isinstance(message, list) and message else ", ".join(parts)
            raise LookupError(f"--field {path}: there is no {part!r} here; there are: {known or 'none'}") from None
    return _json(message)


def _json(message: Any) -> str:
    return msgspec.json.encode(message).decode()


def _tick(message: dict[str, Any]) -> str:
    tasks, index = message["tasks"], message["task_index"]
    task = f"{tasks[index]['kind']} {tasks[index]['target']}" if index < len(tasks) else "all tasks have ended"
    return f"{message['time']:8.2f} s  {_pose(message['robot']['pose'])}  {task}  {message['stop_reason']}".rstrip()


def _robot(message: dict[str, Any]) -> str:
    v, w = message["twist"]
    q = " ".join(f"{angle:5.2f}" for angle in message["q"])
    return (
        f"{message['time']:8.2f} s  {_pose(message['pose'])}  {v:5.2f} m/s {w:5.2f} rad/s  q {q}  "
        f"gripper {message['gripper_width'] * 1000:.0f} mm"
    )


def _scan(message: dict[str, Any]) -> str:
    seen = [distance for distance in message["ranges"] if distance is not None]
    nearest = f"nearest {min(seen):.2f} m" if seen else "nothing in range"
    return f"{message['stamp']:8.2f} s  {len(seen)} of {len(message['ranges'])} beams return, {nearest}"


def _metrics(message: dict[str, Any]) -> str:
    period = message["period_ms"]
    times = f"period p50 {period['p50']:.1f} p99 {period['p99']:.1f} ms" if period else "no periods"
    return (
        f"{message['time']:8.2f} s  {message['tasks_done']}/{message['tasks_total']} tasks  "
        f"contacts {message['contacts_caused_by_robot']} caused of {message['contacts']}  {times}  "
        f"{message['actual_speed']:g} x real time  "
        f"{message['memory_mb']:.0f} MB"
    )


def _status(message: dict[str, Any]) -> str:
    driver = f"  driven by {message['driver_name']}" if message["driver"] else ""
    scene = " ".join(part for part in (message["scene"], message["variant"]) if part)
    return f"{message['time']:8.2f} s  {scene}: {message['state']}{driver}  {message['text']}".rstrip()


def _pose(pose: list[float]) -> str:
    return f"base ({pose[0]:6.3f}, {pose[1]:6.3f}, {pose[2]:6.3f})"


_LINES = {
    "tick": _tick,
    "robot": _robot,
    "scan": _scan,
    "grid": lambda info: (
        f"{info['stamp']:8.2f} s  {info['width']} x {info['height']} cells of {info['resolution']:g} m"
    ),
    "event": lambda m: f"{m['time']:8.2f} s  #{m['seq']}  {m['kind']}: {m['text']}",
    "metrics": _metrics,
    "status": _status,
    "scene": lambda m: f"{m['name']} {m['variant']}, seed {m['seed']}: {len(m['tasks'])} tasks",
}


def twins(endpoint: _Endpoint = None, json: _Json = False) -> int:
    """List the twins that run on this machine, or behind an endpoint (or that of MOTM_ZENOH_CONFIG).

    Exit code 0: there is one that answers; 1: there is none.

    Args:
        endpoint: Address of a twin server or router.
        json: Print JSON, one line each.
    """
    from motm_twin.client.discover import BEHIND, NoTwin, running_twins

    try:
        found = running_twins(endpoint)
    except NoTwin as error:
        print(f"motm-twin twins: {error}", file=sys.stderr)
        return FAILED
    for twin in found:
        print(_json(twin) if json else printable(_line(twin)))
    if not found and not json:
        where = "on this machine: start one with `motm-twin serve`" if endpoint is None else f"at {endpoint}: {BEHIND}"
        print(f"motm-twin twins: no twin is running {where}", file=sys.stderr)
    return OK if any(twin.alive for twin in found) else FAILED


def _line(twin: "Found") -> str:
    page = f"  page: {twin.page}" if twin.page else ""
    if not twin.alive:
        return f"{twin.twin}  {twin.endpoint}{page}  does not answer"
    driver = f"  driven by {twin.driver}" if twin.driver else ""
    minutes = math.floor(twin.time / 60.0)
    return (
        f"{twin.twin}  {twin.endpoint}{page}  {twin.scene}: {twin.state} at {minutes}:{twin.time % 60.0:04.1f}{driver}"
    )


_ALL = (*commands.SERVER_COMMANDS, *commands.EDITS)
KINDS: dict[str, type[Any]] = dict(zip(commands.COMMAND_NAMES, _ALL, strict=True))


def send(
    command: Annotated[Positional[str], arg(metavar="COMMAND")],
    fields: Annotated[Positional[tuple[str, ...]], arg(metavar="NAME=VALUE")] = (),
    /,
    json: Annotated[str | None, arg(name="json", metavar="{...}")] = None,
    timeout: float = 2.0,
    endpoint: _Endpoint = None,
    twin: _Name = None,
) -> int:
    """Send a command to a running twin, print its answer as JSON, and let others drive again.

    Exit code 0: done; 1: refused, or no twin answers; 2: bad input.

    Args:
        command: Name of the command, such as play or add_obstacle; docs/zenoh.md lists them.
        fields: Fields of the command: name=crate x=1.0 y=-0.5 size=0.3,0.3,0.4
        json: Fields as JSON instead.
        timeout: Time to wait for the answer [s].
        endpoint: Address of the twin server; without it, that of MOTM_ZENOH_CONFIG, or the twin on this machine.
        twin: Name of the twin.
    """
    from motm_twin.client.discover import OPTIONS, NoTwin, find
    from motm_twin.client.twin import Twin

    try:
        parsed = parse(command, fields, json)
    except ValueError as error:
        print(f"motm-twin send: {error}", file=sys.stderr)
        return BAD_INPUT
    try:
        with Twin(*find(endpoint, twin, how=OPTIONS), name="motm-twin send") as handle:
            return _sent(handle, parsed, timeout)
    except (NoTwin, TimeoutError) as error:
        print(f"motm-twin send: {error}", file=sys.stderr)
        return FAILED


def parse(command: str, fields: Sequence[str], json: str | None = None) -> commands.Command:
    """The command of this name with fields "name=value", or as JSON. Raises ValueError with what is allowed.

    A load without a method means the default one, as in `serve` and in Python; the message then names it.
    """
    kind = KINDS.get(command)
    if kind is None:
        raise ValueError(f"there is no command {command!r}; {hint(command, KINDS)}")
    types = get_type_hints(kind)
    try:
        values = {} if json is None else msgspec.json.decode(json, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeError) as error:
        raise ValueError(f"--json: give an object of fields: {error}") from error
    for word in fields:
        name, equals, text = word.partition("=")
        if not equals:
            raise ValueError(f"{word!r}: write the fields of {command!r} as name=value")
        if name not in types:
            raise ValueError(f"{command!r} has no field {name!r}; it has: {', '.join(types) or 'none'}")
        values[name] = _value(name, text, types[name])
    if kind is commands.Load:
        values.setdefault("method", DEFAULT_METHOD)
    try:
        return msgspec.convert({**values, "type": command}, type=kind)
    except msgspec.ValidationError as error:
        raise ValueError(f"{command!r}: {error}") from error


def _value(name: str, text: str, kind: Any) -> Any:
    """A word converted to the type of its field: as JSON if that fits, as a list without brackets, or as plain text."""
    for candidate in (text, f"[{text}]"):
        try:
            return msgspec.to_builtins(msgspec.json.decode(candidate, type=kind))
        except (msgspec.DecodeError, UnicodeError):
            continue
    try:
        return msgspec.to_builtins(msgspec.convert(text, type=kind, strict=False))
    except msgspec.ValidationError as error:
        raise ValueError(f"{name}={text}: {error}") from error


def _sent(handle: "Twin", command: commands.Command, timeout: float) -> int:
    try:
        answer = handle.send(command, timeout)
    except commands.Refused as refusal:
        print(_json({"ok": False, "reason": str(refusal)}))
        return FAILED
    print(_json(answer))
    if not isinstance(command, commands.TakeWheel | commands.HandOver | commands.Inspect | commands.Audience):
        handle.client.command(commands.HandOver())  # this program ends: others need not wait for its lease
    return OK


@dataclass(frozen=True, kw_only=True)
class LinkSettings:
    """An emulated link between robot and twin; without any of these it is perfect.

    Args:
        latency: Emulated link: delay of each message [s], in each direction.
        jitter: Emulated link: the delay varies by up to this much, either way [s].
        loss: Emulated link: share of messages that are lost, 0 to 1.
        outage: Emulated link: duration of outages [s], in which nothing arrives in either direction.
        every: Emulated link: time [s] in which one outage falls, at a random moment.
        link_seed: Seed of the emulated link.
    """

    latency: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    every: float = 2.0
    link_seed: int = 0


@dataclass(frozen=True, kw_only=True)
class RobotSettings:
    """The robot's scene, twin and clock.

    Args:
        scene: Shipped scene or path to a scene file; the twin may load another one.
        variant: Named variant of the scene; without it the scene's default.
        seed: Seed of noise and random arrangements; without it the scene's.
        twin: Name of the twin in the Zenoh keys.
        endpoint: Address of the twin's server or of a Zenoh router; the robot waits for it. Without it, that of
            MOTM_ZENOH_CONFIG, or tcp/127.0.0.1:7447.
        clock: real: time passes by itself; shared: it passes as fast as the twin grants it.
        link: Emulated link.
        physics: kinematic, or mujoco: contact dynamics (docs/physics.md).
        json: Write the report to a file, or to standard output with '-'.
        child: For programs that start a robot: end when standard input ends, too, and print nothing about the twin.
    """

    scene: Annotated[Positional[str], arg(metavar="[SCENE]")] = "exp1"
    variant: Annotated[str | None, arg(metavar="NAME")] = None
    seed: Seed = None
    twin: str = "frankie"
    endpoint: Annotated[str | None, arg(metavar="ENDPOINT")] = None
    clock: Literal["real", "shared"] = "real"
    link: Annotated[LinkSettings, arg(name="")] = field(default_factory=LinkSettings)
    physics: Literal["kinematic", "mujoco"] = "kinematic"
    json: Annotated[str, arg(name="json", metavar="FILE|-")] = "-"
    child: FlagCreatePairsOff[bool] = False


def robot(settings: Annotated[RobotSettings, arg(name="")]) -> int:
    """Simulate the robot of a twin that runs with `serve --plant zenoh`, with a referee, in its own process.

    Runs until Ctrl-C or SIGTERM and then prints the referee's counts. Standard error says where it waits for its twin
    and when they have met. Exit code 0: the robot caused no contact; 1: it caused one; 2: bad input.
    """
    from motm_twin.bus.connection import DEFAULT_PORT, LOOPBACK, configured_endpoint
    from motm_twin.processes import leave

    def say(text: str) -> None:
        if not settings.child:
            print(f"motm-twin robot: {text}", file=sys.stderr, flush=True)

    twin = settings.twin
    try:
        leads = configured_endpoint()  # an unusable file is refused in any case
        endpoint = settings.endpoint or leads or f"tcp/{LOOPBACK}:{DEFAULT_PORT}"
        server = _server(settings, endpoint, lambda: say(f"has met the twin {twin!r} at {endpoint}"))
    except ValueError as error:
        print(f"motm-twin robot: {error}", file=sys.stderr)
        return BAD_INPUT
    say(f"waiting for a twin {twin!r} at {endpoint} (motm-twin serve --plant zenoh); Ctrl-C ends it")
    server.run()
    if not server.met:
        say(f"no twin {twin!r} was met at {endpoint}")
    counted = server.robot.report()
    server.close()
    write_json(counted, settings.json)
    leave(FAILED if counted["contacts_caused_by_robot"] or counted["dropped"] else OK)
    return OK


def _server(settings: RobotSettings, endpoint: str, on_met: Callable[[], None]) -> "RobotServer":
    from motm_twin.external.robot import LinkSpec
    from motm_twin.external.robot_server import RobotServer
    from motm_twin.model.scene_file import load_scene
    from motm_twin.plants import with_plant
    from motm_twin.processes import stop_event

    link = asdict(settings.link)
    return RobotServer(
        with_plant(load_scene(settings.scene, settings.variant, settings.seed), settings.physics),
        endpoint,
        twin=settings.twin,
        clock=settings.clock,
        link=LinkSpec(seed=link.pop("link_seed"), **link),
        stop=stop_event(settings.child),  # before this, while imports run, a signal ends the program
        on_met=on_met,
    )
