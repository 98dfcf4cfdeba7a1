"""Rights over Zenoh, as its access control: everything that is not allowed here is denied.

Rules name messages as they pass the server: ``ingress`` comes from the client, ``egress`` goes to it.
"""

from collections.abc import Sequence
from typing import Any

from motm_twin.bus.credentials import USER

STATE = (
    "tick",
    "grid",
    "scene",
    "status",
    "robot",
    "scan",
    "observations",
    "event",
    "metrics",
    "session",
    "schema/**",
    "alive",
)
READABLE = tuple(f"motm/*/{key}" for key in STATE)
COMMANDS = ("motm/*/cmd/**",)
OF_THE_TWIN = ("motm/*/plant/command", "motm/*/plant/grant")  # which a robot only hears
ASKED_BY_THE_TWIN = ("motm/*/plant/reset", "motm/*/plant/edit", "motm/*/plant/tasks")
# Key chunks that begin with @ are matched by no wildcard. Those of ROS 2: tokens of its two forms, and what advanced
# publishers (latched topics) keep and say of themselves.
ROS2 = ("@/*/@ros2_lv/**", "@ros2_lv/**", "**/@adv/**")
ASKING = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
TOLD = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
EVERYTHING = [*ASKING, *TOLD]
ROLES = ("viewer", "driver", "robot", "twin")

# Names by role; a robot has the name of the twin that it belongs to, a twin at a router its own.
Named = dict[str, Sequence[str]]


def identity(role: str, name: str) -> str:
    """The common name, or user name, that somebody connects with."""
    return f"{role}-{name}"


def access_control(people: Named, *, by: str) -> dict[str, Any]:
    """The setting ``access_control`` for these people.

    ``by``: "cert_common_names" or "usernames", how they are known. Programs with the password of the user that serves
    may do everything over the loopback interface.
    """
    rules = [
        _rule("everything", ["ingress", "egress"], EVERYTHING, ["**", *ROS2]),
        *_of_people(),
        _rule("forge", ["ingress"], TOLD, (*READABLE, *COMMANDS, *OF_THE_TWIN), permission="deny"),  # only the server
        _rule("ask a robot", ["ingress"], ["query"], ASKED_BY_THE_TWIN, permission="deny"),
    ]
    subjects: list[dict[str, Any]] = [
        {"id": "here", "interfaces": ["lo"], "link_protocols": ["tcp"], "usernames": [USER]}
    ]
    policies = [{"subjects": ["here"], "rules": ["everything", "forge", "ask a robot"]}]
    _grant(people, by, rules, subjects, policies)
    return _denying(rules, subjects, policies)


def router_access_control(people: Named, *, by: str) -> dict[str, Any]:
    """The same for a router: each twin speaks on its own keys, the others may what they may at a twin itself."""
    rules = [*_of_people(), _rule("be asked", ["egress"], ASKING, ["motm/**"])]
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    _grant(people, by, rules, subjects, policies)
    for twin in people.get("twin", ()):
        known = identity("twin", twin)
        rules.append(_rule(known, ["ingress", "egress"], EVERYTHING, [f"motm/{twin}/**"]))
        subjects.append({"id": known, by: [known]})
        policies.append({"subjects": [known], "rules": [known, "be asked"]})
    return _denying(rules, subjects, policies)


def _of_people() -> list[dict[str, Any]]:
    return [
        _rule("ask", ["ingress"], ASKING, READABLE),
        _rule("be told", ["egress"], TOLD, READABLE),
        _rule("command", ["ingress"], ["query"], COMMANDS),
        _rule("be answered", ["egress"], ["reply", "declare_queryable"], COMMANDS),
    ]


def _grant(
    people: Named, by: str, rules: list[dict[str, Any]], subjects: list[dict[str, Any]], policies: list[dict[str, Any]]
) -> None:
    """Add viewers, drivers and robots."""
    for role, granted in (
        ("viewer", ["ask", "be told"]),
        ("driver", ["ask", "be told", "command", "be answered"]),
    ):
        if people.get(role):
            subjects.append({"id": role, by: [identity(role, name) for name in people[role]]})
            policies.append({"subjects": [role], "rules": granted})
    for twin in people.get("robot", ()):
        known = identity("robot", twin)
        rules.append(_rule(known, ["ingress", "egress"], EVERYTHING, [f"motm/{twin}/plant/**"]))
        rules.append(_rule(f"{known} obeys", ["ingress"], ["put", "delete"], OF_THE_TWIN, permission="deny"))
        rules.append(_rule(f"{known} answers", ["ingress"], ["query"], ASKED_BY_THE_TWIN, permission="deny"))
        subjects.append({"id": known, by: [known]})
        policies.append({"subjects": [known], "rules": [known, f"{known} obeys", f"{known} answers"]})


def _denying(
    rules: list[dict[str, Any]], subjects: list[dict[str, Any]], policies: list[dict[str, Any]]
) -> dict[str, Any]:
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(
    name: str, flows: list[str], messages: list[str], keys: Sequence[str], *, permission: str = "allow"
) -> dict[str, Any]:
    return {"id": name, "permission": permission, "flows": flows, "messages": messages, "key_exprs": list(keys)}
