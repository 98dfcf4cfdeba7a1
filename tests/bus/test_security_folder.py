"""The folder of certificates: what it holds, and what it refuses."""

import json
import stat

import pytest
import zenoh
from cryptography import x509

from motm_twin.bus.connection import VARIABLE, ConfigError, session_config
from motm_twin.bus.security import Folder, People, SecurityError
from motm_twin.cli import main


def folder(path, **changes):
    made = Folder(path)
    people = {"hosts": ["robot.example", "10.0.0.7"], "port": 7448, "names": {"viewer": ["ann"], "driver": ["bob"]}}
    made.create(People(**(people | changes)))
    return made


@pytest.mark.parametrize("passwords", [False, True])
def test_every_file_is_a_zenoh_configuration_and_secrets_are_for_the_owner_only(tmp_path, passwords):
    made = folder(tmp_path / "s", passwords=passwords)
    for file in made.path.glob("*.json5"):
        found = zenoh.Config.from_file(str(file))
        assert json.loads(found.get_json("scouting/multicast/enabled")) is False
        assert json.loads(found.get_json("transport/link/rx/max_message_size")) == 16 * 1024 * 1024
    for file in made.path.iterdir():
        public = file.suffix == ".crt" or file.name == "people.json"
        assert stat.S_IMODE(file.stat().st_mode) & 0o077 == (0o044 if public else 0)
    assert stat.S_IMODE(made.path.stat().st_mode) & 0o077 == 0


def test_the_certificate_of_the_server_names_its_hosts(tmp_path):
    made = folder(tmp_path / "s")
    names = x509.load_pem_x509_certificate((made.path / "server.crt").read_bytes()).extensions
    found = names.get_extension_for_class(x509.SubjectAlternativeName).value
    assert found.get_values_for_type(x509.DNSName) == ["robot.example"]
    assert [str(item) for item in found.get_values_for_type(x509.IPAddress)] == ["10.0.0.7"]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"hosts": []}, "name at least one host"),
        ({"hosts": ["a b"]}, "name at least one host"),
        ({"port": 0}, "use 1 to 65535"),
        ({"names": {"king": ["x"]}}, "unknown role"),
        ({"names": {"viewer": ["../x"]}}, "letters, digits"),
        ({"names": {"viewer": ["ada", "ada"]}}, "viewer 'ada' is named twice"),
    ],
)
def test_what_can_not_be_is_refused_and_leaves_nothing(tmp_path, changes, reason):
    with pytest.raises(SecurityError, match=reason):
        folder(tmp_path / "s", **changes)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda made: made.add({"viewer": ["eve", "ann"]}), "'ann' is known already"),
        (lambda made: made.add({"viewer": ["eve"], "driver": ["../x"]}), "letters, digits"),
        (lambda made: made.add({"viewer": ["eve", "eve"]}), "'eve' is named twice"),
        (lambda made: made.add({"viewer": ["eve"], "twin": ["a1"]}), "not of a router"),
        (lambda made: made.add({"viewer": ["eve"]}, days=-1), "-1 days: use 1 to 3650"),
        (
            lambda made: made.remove({"viewer": ["ann"], "driver": ["zed"]}),
            "there is no driver 'zed'; there are: viewer ann, driver bob",
        ),
        (lambda made: made.remove({"viewer": ["ann", "ann"]}), "'ann' is named twice"),
    ],
)
def test_a_change_of_which_one_part_is_refused_changes_nothing(change, reason, tmp_path):
    """The names before the refused one were added or removed, with exit code 2 that promises no change."""
    made = folder(tmp_path / "s")
    before = {file.name: file.read_bytes() for file in made.path.iterdir()}
    with pytest.raises(SecurityError, match=reason):
        change(made)
    assert {file.name: file.read_bytes() for file in made.path.iterdir()} == before


def test_nobody_is_added_when_the_key_that_signs_is_gone(tmp_path):
    """The password of the new one was in the server's list already."""
    made = folder(tmp_path / "s")
    (made.path / "ca.key").unlink()
    before = {file.name: file.read_bytes() for file in made.path.iterdir()}
    with pytest.raises(SecurityError, match=r"authority of .* can not be used"):
        made.add({"viewer": ["eve"]})
    assert {file.name: file.read_bytes() for file in made.path.iterdir()} == before


@pytest.mark.parametrize("days", [-1, 0, 3651, 10**12])
def test_days_that_cannot_be_are_refused_and_leave_nothing(days, tmp_path):
    """It raised a ValueError of the certificate, and left half a folder."""
    people = People(hosts=["robot.example"], port=7448, names={"viewer": ["ann"]})
    with pytest.raises(SecurityError, match=f"{days} days: use 1 to 3650"):
        Folder(tmp_path / "s").create(people, days=days)
    assert not (tmp_path / "s").exists()


def test_a_folder_with_files_is_never_written_over(tmp_path):
    made = folder(tmp_path / "s")
    before = {file.name: file.read_bytes() for file in made.path.iterdir()}
    with pytest.raises(SecurityError, match="is not empty"):
        folder(tmp_path / "s")
    assert {file.name: file.read_bytes() for file in made.path.iterdir()} == before


def test_add_and_remove_change_the_rights_and_nobody_elses_file(tmp_path):
    made = folder(tmp_path / "s")
    bob = made.of("driver", "bob").read_bytes()
    made.add({"viewer": ["eve"]})
    assert "viewer-eve" in made.server.read_text()
    made.remove({"viewer": ["ann"]})
    assert "viewer-ann" not in made.server.read_text()
    assert not made.of("viewer", "ann").exists()
    assert made.of("driver", "bob").read_bytes() == bob
    with pytest.raises(SecurityError, match="there is no viewer 'ann'"):
        made.remove({"viewer": ["ann"]})
    with pytest.raises(SecurityError, match="known already"):
        made.add({"viewer": ["eve"]})


def test_the_command_makes_changes_and_lists(tmp_path, monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr("sys.argv", ["motm-twin", "security", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    place = str(tmp_path / "s")
    assert run("make", place)[0] == 2
    code, said = run("make", place, "--host", "localhost", "--viewer", "ann", "--driver", "bob")
    assert code == 0
    assert "MOTM_ZENOH_CONFIG=viewer-ann.json5 motm-twin watch tick)" in said.out
    assert "MOTM_ZENOH_CONFIG=driver-bob.json5 motm-twin send pause)" in said.out
    code, said = run("add", place, "--robot", "mine")
    assert code == 0
    assert "MOTM_ZENOH_CONFIG=robot-mine.json5 motm-twin robot exp1 --twin mine)" in said.out  # it may not watch
    code, said = run("list", place)
    assert "robot mine" in said.out
    assert run("remove", place, "--viewer", "nobody")[0] == 2
    code, said = run("remove", place, "--viewer", "ann")
    assert code == 0
    assert "Hand over" not in said.out
    code, said = run("make", f"{place}-router", "--host", "localhost", "--twin", "a1")
    assert "MOTM_ZENOH_CONFIG=twin-a1.json5 motm-twin serve exp1 --twin a1 --zenoh-port 0)" in said.out
    assert run("add", place)[0] == 2


def test_a_configuration_that_can_not_be_read_is_named(tmp_path, monkeypatch):
    bad = tmp_path / "bad.json5"
    bad.write_text("{ mode: ")
    monkeypatch.setenv(VARIABLE, str(bad))
    with pytest.raises(ConfigError, match=r"bad\.json5"):
        session_config(listen=[], connect=[])
    monkeypatch.setenv(VARIABLE, str(tmp_path / "none.json5"))
    with pytest.raises(ConfigError, match=r"none\.json5"):
        session_config(listen=[], connect=[])


@pytest.mark.parametrize(
    "endpoint", ["foo", "", "tcp/", "127.0.0.1:7447", "tcp 127.0.0.1:7447", "tcp/127.0.0.1", "ftp/a:1"]
)
def test_an_endpoint_that_is_none_is_refused_with_an_example(endpoint):
    with pytest.raises(ConfigError, match=f"endpoint '{endpoint}' is none of Zenoh: write it as tcp/127.0.0.1:7447"):
        session_config(listen=[], connect=[endpoint])


@pytest.mark.parametrize(
    "endpoint", ["tcp/[::1]:7447", "tls/twin.example:7448", "udp/10.0.0.1:7447#iface=eth0", "unixsock-stream//tmp/twin"]
)
def test_every_endpoint_of_zenoh_is_taken(endpoint):
    assert endpoint in session_config(listen=[], connect=[endpoint]).get_json("connect/endpoints")
