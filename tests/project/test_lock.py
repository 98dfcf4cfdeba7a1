"""The lock files: complete, hashed, and silent about where packages come from."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LOCKS = ("requirements.lock", "requirements-dev.lock", "requirements-build.lock", "requirements-docs.lock")
REQUIREMENT = re.compile(r"^([a-z0-9-]+)==([^\s;]+)(?: ; [^\\]+?)?(?: \\)?$")


def pins(name: str) -> dict[str, set[str]]:
    """Pinned versions by normalised name (several where an environment marker chooses)."""
    found: dict[str, set[str]] = {}
    for line in (ROOT / name).read_text().splitlines():
        if match := REQUIREMENT.match(line):
            found.setdefault(match[1], set()).add(match[2])
    return found


def normalised(requirement: str) -> str:
    return re.sub(r"[-_.]+", "-", re.split(r"[\[<>=!~ ;]", requirement)[0]).lower()


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_names_no_address(name: str):
    text = (ROOT / name).read_text()
    assert "://" not in text
    assert not re.search(r"^\s*(-i|-f|--index-url|--extra-index-url|--find-links|--trusted-host)\b", text, re.M)
    assert " @ " not in text


@pytest.mark.parametrize("name", LOCKS)
def test_every_requirement_of_a_lock_is_pinned_and_hashed(name: str):
    blocks: list[list[str]] = []
    for line in (ROOT / name).read_text().splitlines():
        if line.startswith("#"):
            continue
        if line.startswith(" "):
            blocks[-1].append(line.strip().rstrip("\\").strip())
        else:
            blocks.append([line])
    assert blocks
    for requirement, *hashes in blocks:
        assert REQUIREMENT.match(requirement), requirement
        assert hashes, requirement
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", one) for one in hashes), requirement


def test_the_locks_hold_every_declared_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    runtime = {normalised(one) for one in project["project"]["dependencies"]}
    dev = {normalised(one) for one in project["project"]["optional-dependencies"]["dev"]}
    docs = {normalised(one) for one in project["project"]["optional-dependencies"]["docs"]}
    build = {normalised(one) for one in project["build-system"]["requires"]}
    assert runtime <= set(pins("requirements.lock"))
    assert docs <= set(pins("requirements-docs.lock"))
    assert runtime | dev | docs <= set(pins("requirements-dev.lock"))
    assert build <= set(pins("requirements-build.lock"))


def test_the_locks_agree_on_every_version():
    dev = pins("requirements-dev.lock")
    for name in LOCKS:
        for package, versions in pins(name).items():
            assert versions == dev[package], package


def test_licences_that_would_bind_users_are_not_in_the_runtime_lock():
    gpl = {"quadprog", "cvxopt", "qpalm", "pymeshlab"}
    assert not gpl & set(pins("requirements.lock"))
