"""The container image as it is described; `make image` builds and tries it."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text()
LAST_STAGE = DOCKERFILE[DOCKERFILE.rindex("\nFROM ") :]


def test_every_stage_starts_from_debian_bookworm_slim():
    bases = re.findall(r"^FROM (\S+)", DOCKERFILE, re.M)
    assert bases
    assert set(bases) == {"debian:bookworm-slim"}


def test_the_image_runs_as_a_user_without_rights():
    users = re.findall(r"^USER (\S+)", LAST_STAGE, re.M)
    assert users[-1] not in {"root", "0"}


def test_the_image_has_a_health_check():
    assert "HEALTHCHECK" in LAST_STAGE


def test_packages_of_the_image_come_from_the_hashed_lock():
    installs = [line for line in DOCKERFILE.splitlines() if "pip $pip" in line or "pip install" in line]
    assert all("--require-hashes" in line or "--no-deps" in line for line in installs)


def test_the_container_never_listens_without_a_token():
    entry = (ROOT / "tools" / "container.sh").read_text()
    assert entry.index("MOTM_TOKEN") < entry.index("--host 0.0.0.0")
    assert "secrets.token_urlsafe(32)" in entry


def test_the_build_context_leaves_out_what_is_not_listed():
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    assert lines[0] == "*"
    for needed in ("requirements*.lock", "motm_twin", "web_assets", "scenes", "build/wheels"):
        assert f"!{needed}" in lines
