"""A folder with all that a twin and its clients on other machines need, one file each; and their rights over Zenoh.

The file of a client contains its certificates and secrets: hand it over as a whole, over a safe channel. Rights are
Zenoh's access control: anything not allowed here is denied. Rules name messages as they pass the server: ``ingress``
comes from the client, ``egress`` goes to it.
"""

import base64
import datetime
import ipaddress
import json
import re
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import yaml
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from motm_twin.bus.connection import SHIPPED
from motm_twin.bus.private_folder import USER, write_private

AUTHORITY_DAYS = 3650
BACKDATED = datetime.timedelta(minutes=5)  # clocks of machines differ


@dataclass(frozen=True)
class Identity:
    """A certificate and its private key, both PEM."""

    certificate: bytes
    key: bytes


class Authority:
    """Signs certificates."""

    def __init__(self, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
        self._certificate, self._key = certificate, key

    @classmethod
    def create(cls, name: str) -> "Authority":
        """A new authority, valid for ten years."""
        key = ec.generate_private_key(ec.SECP256R1())
        subject = _name(name)
        builder = _builder(subject, subject, key.public_key(), AUTHORITY_DAYS)
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        builder = builder.add_extension(_key_usage(signs_certificates=True), critical=True)
        builder = builder.add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        return cls(builder.sign(key, hashes.SHA256()), key)

    @property
    def certificate(self) -> bytes:
        """PEM."""
        return self._certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def key(self) -> bytes:
        """PEM; keep it secret: whoever has it can impersonate anybody."""
        return _pem(self._key)

    def issue(self, name: str, *, days: int, hosts: Sequence[str] = ()) -> Identity:
        """A certificate with this common name, valid from now for ``days``; ``hosts``: where a server is found."""
        key = ec.generate_private_key(ec.SECP256R1())
        builder = _builder(_name(name), self._certificate.subject, key.public_key(), days)
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        builder = builder.add_extension(_key_usage(signs_certificates=False), critical=True)
        use = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = builder.add_extension(x509.ExtendedKeyUsage([use]), critical=False)
        issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key())
        builder = builder.add_extension(issuer, critical=False)
        if hosts:
            names = x509.SubjectAlternativeName([_host(host) for host in hosts])
            builder = builder.add_extension(names, critical=False)
        certificate = builder.sign(self._key, hashes.SHA256())
        return Identity(certificate.public_bytes(serialization.Encoding.PEM), _pem(key))


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _builder(
    subject: x509.Name, issuer: x509.Name, public_key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    builder = x509.CertificateBuilder().subject_name(subject).issuer_name(issuer).public_key(public_key)
    builder = builder.serial_number(x509.random_serial_number()).not_valid_before(now - BACKDATED)
    return builder.not_valid_after(now + datetime.timedelta(days=days))


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


STATE = (
    *("tick", "grid", "scene", "status", "robot", "scan", "observations", "event", "metrics"),
    *("session", "schema/**", "alive"),
)
READABLE = tuple(f"motm/*/{key}" for key in STATE)
COMMANDS = ("motm/*/cmd/**",)
OF_THE_TWIN = ("motm/*/plant/command", "motm/*/plant/grant")  # a robot only receives these
ASKED_BY_THE_TWIN = ("motm/*/plant/reset", "motm/*/plant/edit", "motm/*/plant/tasks")
# No wildcard matches key chunks that begin with @, so those of ROS 2 are listed: liveliness tokens in both forms, and
# the caches and announcements of advanced publishers (latched topics).
ROS2 = ("@/*/@ros2_lv/**", "@ros2_lv/**", "**/@adv/**")
ASKING = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
TOLD = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
EVERYTHING = [*ASKING, *TOLD]
ROLES = ("viewer", "driver", "robot", "twin")

# Names by role; a robot has the name of the twin that it belongs to, a twin at a router its own.
Named = Mapping[str, Sequence[str]]
Json = dict[str, Any]
Granted = tuple[Json, list[str]]  # a subject, and the names of its rules


def each(named: Named) -> list[tuple[str, str]]:
    """Role and name of every client."""
    return [(role, name) for role, names in named.items() for name in names]


def identity(role: str, name: str) -> str:
    """The common name, or user name, with which a client connects."""
    return f"{role}-{name}"


def access_control(people: Named, *, by: str) -> Json:
    """The setting ``access_control`` for these people.

    ``by``: "cert_common_names" or "usernames", which identify them. Programs with the password of the serving user
    may do everything over the loopback interface.
    """
    of_robots, granted = _granted(people, by)
    rules = [
        _rule("everything", ["ingress", "egress"], EVERYTHING, ["**", *ROS2]),
        *_of_people(),
        _rule("forge", ["ingress"], TOLD, (*READABLE, *COMMANDS, *OF_THE_TWIN), permission="deny"),  # only the server
        _rule("ask a robot", ["ingress"], ["query"], ASKED_BY_THE_TWIN, permission="deny"),
    ]
    here = {"id": "here", "interfaces": ["lo"], "link_protocols": ["tcp"], "usernames": [USER]}
    return _denying([*rules, *of_robots], [(here, ["everything", "forge", "ask a robot"]), *granted])


def router_access_control(people: Named, *, by: str) -> Json:
    """The same for a router: each twin publishes on its own keys; other clients have the same rights as at a twin."""
    of_robots, granted = _granted(people, by)
    rules = [*_of_people(), _rule("be asked", ["egress"], ASKING, ["motm/**"]), *of_robots]
    for twin in people.get("twin", ()):
        known = identity("twin", twin)
        rules.append(_rule(known, ["ingress", "egress"], EVERYTHING, [f"motm/{twin}/**"]))
        granted.append(({"id": known, by: [known]}, [known, "be asked"]))
    return _denying(rules, granted)


def _of_people() -> list[Json]:
    return [
        _rule("ask", ["ingress"], ASKING, READABLE),
        _rule("be told", ["egress"], TOLD, READABLE),
        _rule("command", ["ingress"], ["query"], COMMANDS),
        _rule("be answered", ["egress"], ["reply", "declare_queryable"], COMMANDS),
    ]


def _granted(people: Named, by: str) -> tuple[list[Json], list[Granted]]:
    """Rules of the robots, and all subjects (viewers, drivers, robots) with the names of their rules."""
    rules: list[Json] = []
    granted: list[Granted] = []
    reads = ["ask", "be told"]
    for role, names in (("viewer", reads), ("driver", [*reads, "command", "be answered"])):
        if people.get(role):
            granted.append(({"id": role, by: [identity(role, name) for name in people[role]]}, names))
    for twin in people.get("robot", ()):
        known = identity("robot", twin)
        rules.append(_rule(known, ["ingress", "egress"], EVERYTHING, [f"motm/{twin}/plant/**"]))
        rules.append(_rule(f"{known} obeys", ["ingress"], ["put", "delete"], OF_THE_TWIN, permission="deny"))
        rules.append(_rule(f"{known} answers", ["ingress"], ["query"], ASKED_BY_THE_TWIN, permission="deny"))
        granted.append(({"id": known, by: [known]}, [known, f"{known} obeys", f"{known} answers"]))
    return rules, granted


def _denying(rules: list[Json], granted: list[Granted]) -> Json:
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [subject for subject, _ in granted],
        "policies": [{"subjects": [subject["id"]], "rules": names} for subject, names in granted],
    }


def _rule(name: str, flows: list[str], messages: list[str], keys: Sequence[str], *, permission: str = "allow") -> Json:
    return {"id": name, "permission": permission, "flows": flows, "messages": messages, "key_exprs": list(keys)}


PEOPLE_VERSION = "motm.security/2"
DAYS = 365
NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")
HOST = re.compile(r"[A-Za-z0-9.:-]{1,253}")
_SECRET, _PUBLIC = 0o600, 0o644


class SecurityError(ValueError):
    """A request that can not be met; the message says why."""


class People(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Known people, and the address of the twin: `people.json` of the folder."""

    version: str = PEOPLE_VERSION
    hosts: list[str]  # names and addresses of the server; the first one is written into the files of clients
    port: int
    passwords: bool = False  # user and password alone within TLS, without certificates of clients
    names: dict[str, list[str]] = {}  # by role

    def check(self) -> None:
        """Raise SecurityError for values that cannot be used."""
        if self.version != PEOPLE_VERSION:
            raise SecurityError(
                f"people.json has version {self.version!r}: make the folder anew, this program reads {PEOPLE_VERSION!r}"
            )
        if not self.hosts or not all(HOST.fullmatch(host) for host in self.hosts):
            raise SecurityError("name at least one host: the DNS name or address under which clients find the server")
        if not 1 <= self.port <= 65535:
            raise SecurityError(f"port {self.port}: use 1 to 65535")
        for role, names in self.names.items():
            if role not in ROLES:
                raise SecurityError(f"unknown role {role!r}: there are {', '.join(ROLES)}")
            for name in names:
                if not NAME.fullmatch(name):
                    raise SecurityError(f"{role} {name[:60]!r}: use 1 to 40 letters, digits, '_' or '-'")


def _check(named: Named, days: int = DAYS) -> None:
    """Raise SecurityError for a name that is given twice, and for an impossible number of days."""
    people = each(named)
    for role, name in people:
        if people.count((role, name)) > 1:
            raise SecurityError(f"{role} {name[:60]!r} is named twice")
    if not 1 <= days <= AUTHORITY_DAYS:
        raise SecurityError(f"{days} days: use 1 to {AUTHORITY_DAYS}, for which the authority is valid")


class Folder:
    """The files of one server and its clients."""

    def __init__(self, path: Path) -> None:
        self.path = path
        # Zenoh configurations: of the twin server, of its own processes on that machine, and of a router to which twins
        # connect, which exists when twins are known.
        self.server, self.here, self.router = (path / f"{name}.json5" for name in ("server", "here", "router"))

    def of(self, role: str, name: str) -> Path:
        """Zenoh configuration of a client."""
        return self.path / f"{identity(role, name)}.json5"

    def known(self) -> People:
        """Known people. Raises SecurityError."""
        file = self.path / "people.json"
        if not file.exists():
            raise SecurityError(f"{self.path} has no people.json: make the folder first with motm-twin security make")
        try:
            people = msgspec.json.decode(file.read_bytes(), type=People)
        except (msgspec.DecodeError, UnicodeDecodeError, OSError) as error:
            raise SecurityError(f"{file}: {error}") from error
        people.check()
        return people

    def ready(self) -> "Folder":
        """This folder, checked to be usable by a server. Raises SecurityError."""
        self.known()
        missing = [file.name for file in (self.server, self.here) if not file.is_file()]
        if missing:
            raise SecurityError(f"{self.path} lacks {', '.join(missing)}: make the folder anew")
        return self

    def create(self, people: People, *, days: int = DAYS) -> list[Path]:
        """Create authority, server and clients; returns the clients' files. Raises SecurityError before it writes."""
        people.check()
        _check(people.names, days)
        if self.path.exists() and any(self.path.iterdir()):
            raise SecurityError(
                f"{self.path} is not empty: choose a new folder, or change who is known with add, remove"
            )
        self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
        authority = Authority.create("motm_twin authority")
        self._write("ca.crt", authority.certificate, _PUBLIC)
        self._write("ca.key", authority.key, _SECRET)
        server = authority.issue("server", days=days, hosts=people.hosts)
        self._write("server.crt", server.certificate, _PUBLIC)
        self._write("server.key", server.key, _SECRET)
        signer = None if people.passwords else authority
        made = [self._client(people, role, name, days, signer) for role, name in each(people.names)]
        self._server(people)
        return made

    def add(self, named: Named, *, days: int = DAYS) -> list[Path]:
        """Admit more clients; returns their files. Takes effect when the server restarts.

        Raises SecurityError before it writes.
        """
        people = self.known()
        _check(named, days)
        if named.get("twin") and not people.names.get("twin"):
            raise SecurityError(f"{self.path} is of a twin, not of a router: make a new folder with --twin")
        for role, name in each(named):
            if name in people.names.setdefault(role, []):
                raise SecurityError(f"{role} {name!r} is known already: remove it first to give it new secrets")
            people.names[role].append(name)
        people.check()
        signer = None if people.passwords else self._authority()
        made = [self._client(people, role, name, days, signer) for role, name in each(named)]
        self._server(people)
        return made

    def remove(self, named: Named) -> None:
        """Revoke all rights of clients, from the next start of the server on.

        Raises SecurityError before it writes.
        """
        people, users = self.known(), self._users()
        _check(named)
        known = ", ".join(f"{role} {name}" for role, name in each(people.names))
        for role, name in each(named):
            if name not in people.names.get(role, []):
                raise SecurityError(f"there is no {role} {name[:60]!r}; there are: {known or 'none'}")
            people.names[role] = [other for other in people.names[role] if other != name]
            users.pop(identity(role, name), None)
        for role, name in each(named):
            self.of(role, name).unlink(missing_ok=True)
        self._write_users(users)
        self._server(people)

    def _server(self, people: People) -> None:
        """Write the files that depend on the known people."""
        mutual = not people.passwords
        tls: Json = {
            "listen_certificate_base64": _base64((self.path / "server.crt").read_bytes()),
            "listen_private_key_base64": _base64((self.path / "server.key").read_bytes()),
            "enable_mtls": mutual,
        }
        if mutual:
            tls["root_ca_certificate_base64"] = _base64((self.path / "ca.crt").read_bytes())
        by = "cert_common_names" if mutual else "usernames"
        settings: Json = {
            "listen": {"endpoints": [f"tls/0.0.0.0:{people.port}"]},
            "tls": tls,
            "usrpwd": {"dictionary_file": str((self.path / "users.txt").resolve())},
            "access_control": access_control(people.names, by=by),
        }
        self._write_users(self._users())  # the list exists even when it is empty
        if people.names.get("twin"):
            rights = router_access_control(people.names, by=by)
            self._write("router.json5", _settings(**{**settings, "access_control": rights, "mode": "router"}), _SECRET)
        self._write("server.json5", _settings(**settings), _SECRET)
        self._write("here.json5", _settings(), _SECRET)
        self._write("people.json", msgspec.json.format(msgspec.json.encode(people)) + b"\n", _PUBLIC)

    def _client(self, people: People, role: str, name: str, days: int, signer: Authority | None) -> Path:
        """The file of a client; without ``signer`` it has a password alone."""
        tls: Json = {
            "root_ca_certificate_base64": _base64((self.path / "ca.crt").read_bytes()),
            "verify_name_on_connect": True,
        }
        # A router does not forward between peers: viewers and drivers are its clients.
        at_router = bool(people.names.get("twin")) and role != "twin"
        settings: Json = {"mode": "client"} if at_router else {}
        host = f"[{people.hosts[0]}]" if ":" in people.hosts[0] else people.hosts[0]
        settings |= {"connect": {"endpoints": [f"tls/{host}:{people.port}"]}}
        user, password = identity(role, name), secrets.token_urlsafe(24)  # 192 bits
        self._write_users({**self._users(), user: password})
        settings["usrpwd"] = {"user": user, "password": password}
        if signer is not None:
            own = signer.issue(user, days=days)
            tls |= {
                "enable_mtls": True,
                "connect_certificate_base64": _base64(own.certificate),
                "connect_private_key_base64": _base64(own.key),
            }
        self._write(self.of(role, name).name, _settings(tls=tls, **settings), _SECRET)
        return self.of(role, name)

    def _authority(self) -> Authority:
        try:
            key = serialization.load_pem_private_key((self.path / "ca.key").read_bytes(), password=None)
            certificate = x509.load_pem_x509_certificate((self.path / "ca.crt").read_bytes())
            if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
                raise ValueError("ca.key is not the key of ca.crt")
        except (OSError, ValueError) as error:
            raise SecurityError(f"the authority of {self.path} can not be used: {error}") from error
        return Authority(certificate, key)

    def _users(self) -> dict[str, str]:
        file = self.path / "users.txt"
        lines = file.read_text(encoding="utf-8").split() if file.exists() else []
        return dict(line.split(":", 1) for line in lines)

    def _write_users(self, users: dict[str, str]) -> None:
        self._write("users.txt", "".join(f"{user}:{word}\n" for user, word in users.items()).encode(), _SECRET)

    def _write(self, name: str, data: bytes, mode: int) -> None:
        write_private(self.path / name, data, mode)


def _settings(*, tls: Json | None = None, usrpwd: Json | None = None, **sections: Any) -> bytes:
    """A whole configuration: the shipped one with these settings on top."""
    shipped = re.sub(r"//.*", "", SHIPPED.read_text(encoding="utf-8"))  # its JSON5 is YAML without the comments
    config = yaml.safe_load(shipped) | sections
    if tls is not None:
        config["transport"]["link"]["tls"] = tls
    if usrpwd is not None:
        config["transport"]["auth"] = {"usrpwd": usrpwd}
    return (json.dumps(config, indent=2) + "\n").encode()


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
