"""`motm-twin security`: certificates, passwords and rights for programs on other machines."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import FlagCreatePairsOff, Positional, arg

from motm_twin.cli.settings import AddingUp, Words
from motm_twin.program import BAD_INPUT, OK

if TYPE_CHECKING:
    from motm_twin.bus.security import Folder

USES = {  # what each role can do with its file
    "viewer": "motm-twin watch tick",
    "driver": "motm-twin send pause",
    "robot": "motm-twin robot exp1 --twin {name}",
    "twin": "motm-twin serve exp1 --twin {name} --zenoh-port 0",
}


@dataclass(frozen=True, kw_only=True)
class SecuritySettings(AddingUp):
    """The folder, and who may connect.

    Args:
        action: make a new folder; add or remove viewers, drivers, robots; list them.
        folder: The folder; keep it secret, and give each file in it to its owner only.
        host: Names and addresses under which others find the server, the usual one first (make).
        port: TCP port of the TLS listener (make).
        viewer: Names of people who may read.
        driver: Names of people who may read and command.
        robot: Names of twins whose robot runs on another machine.
        twin: Names of twins that meet at a router; the folder is then the router's (docs/scale.md).
        passwords: Use a user name and password within TLS instead of a certificate for each (make).
        days: How long certificates are valid.
    """

    action: Positional[Literal["make", "add", "remove", "list"]]
    folder: Annotated[Positional[Path], arg(metavar="DIR")]
    host: Words = ()
    port: int = 7448
    viewer: Words = ()
    driver: Words = ()
    robot: Words = ()
    twin: Words = ()
    passwords: FlagCreatePairsOff[bool] = False
    days: int = 365

    def names(self) -> dict[str, list[str]]:
        """Names by role."""
        return {role: list(getattr(self, role)) for role in USES}


def security(settings: Annotated[SecuritySettings, arg(name="")]) -> int:
    """Make or change the folder that defines who may connect from other machines.

    Exit code 0: done; 2: bad input, and nothing was changed.
    """
    from motm_twin.bus.security import Folder, SecurityError, each
    from motm_twin.program import plain_console

    console, place = plain_console(), Folder(settings.folder)
    try:
        if settings.action == "list":
            for role, name in each(place.known().names):
                console.print(f"{role} {name}: {place.of(role, name)}", markup=False)
            return OK
        _change(place, settings)
    except (SecurityError, OSError) as error:
        plain_console(stderr=True).print(f"motm-twin security: {error}", markup=False)
        return BAD_INPUT
    if place.router.is_file():
        console.print(f"The router: zenohd --config {place.router}", markup=False)
    else:
        console.print(f"The twin:  motm-twin serve --secure {settings.folder}", markup=False)
    for role, name in each(settings.names()) if settings.action != "remove" else ():
        file, use = place.of(role, name), USES[role].format(name=name)
        console.print(f"Hand over: {file}  (use: MOTM_ZENOH_CONFIG={file.name} {use})", markup=False)
    return OK


def _change(place: "Folder", settings: SecuritySettings) -> None:
    """Make the folder, or add or remove people. Raises SecurityError and OSError."""
    from motm_twin.bus.security import People, SecurityError

    named = settings.names()
    if settings.action == "make":
        people = People(hosts=list(settings.host), port=settings.port, passwords=settings.passwords, names=named)
        place.create(people, days=settings.days)
        return
    if not any(named.values()):
        raise SecurityError(f"{settings.action}: name somebody with --viewer, --driver or --robot")
    if settings.action == "add":
        place.add(named, days=settings.days)
    else:
        place.remove(named)
