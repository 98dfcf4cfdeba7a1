"""`motm-twin security`: certificates, passwords and rights for programs on other machines."""

from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

USES = {  # what each role can do with its file
    "viewer": "motm-twin watch tick",
    "driver": "motm-twin send pause",
    "robot": "motm-twin robot exp1 --twin {name}",
    "twin": "motm-twin serve exp1 --twin {name} --zenoh-port 0",
}


def security(
    action: Positional[Literal["make", "add", "remove", "list"]],
    folder: Annotated[Positional[Path], tyro.conf.arg(metavar="DIR")],
    /,
    host: tuple[str, ...] = (),
    port: int = 7448,
    viewer: tuple[str, ...] = (),
    driver: tuple[str, ...] = (),
    robot: tuple[str, ...] = (),
    twin: tuple[str, ...] = (),
    passwords: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    days: int = 365,
) -> int:
    """Make or change the folder that says who may connect from other machines.

    Exit code 0: done; 2: bad input, and nothing was changed.

    Args:
        action: make a new folder; add or remove viewers, drivers, robots; list them.
        folder: The folder; keep it secret, and hand its files out one by one.
        host: Names and addresses under which others find the server, the usual one first (make).
        port: TCP port of the TLS listener (make).
        viewer: Names of those who read.
        driver: Names of those who read and command.
        robot: Names of twins whose robot lives on another machine.
        twin: Names of twins that meet at a router: then the folder is the router's (docs/scale.md).
        passwords: User and password within TLS, instead of a certificate for each (make).
        days: How long certificates are valid.
    """
    from motm_twin.console import plain_console
    from motm_twin.security.folder import Folder, People, SecurityError

    console, place = plain_console(), Folder(folder)
    named = {"viewer": list(viewer), "driver": list(driver), "robot": list(robot), "twin": list(twin)}
    each = [(role, name) for role, names in named.items() for name in names]
    try:
        if action == "make":
            people = People(hosts=list(host), port=port, passwords=passwords, names=named)
            place.create(people, days=days)
        elif action == "list":
            people = place.people()
            if people is None:
                raise SecurityError(f"{folder} has no people.json: make the folder first")
            for role, names in people.names.items():
                for name in names:
                    console.print(f"{role} {name}: {place.of(role, name)}", markup=False)
            return 0
        else:
            if not each:
                raise SecurityError(f"{action}: name somebody with --viewer, --driver or --robot")
            for role, name in each:
                if action == "add":
                    place.add(role, name, days=days)
                else:
                    place.remove(role, name)
    except (SecurityError, OSError) as error:
        plain_console(stderr=True).print(f"motm-twin security: {error}", markup=False)
        return 2
    if place.router.is_file():
        console.print(f"The router: zenohd --config {place.router}", markup=False)
    else:
        console.print(f"The twin:  motm-twin serve --secure {folder}", markup=False)
    for role, name in each if action != "remove" else ():
        file, use = place.of(role, name), USES[role].format(name=name)
        console.print(f"Hand over: {file}  (use: MOTM_ZENOH_CONFIG={file.name} {use})", markup=False)
    return 0
