"""What a stranger finds in the repository: no traces of one machine, a licence, a citation, no loose ends."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

import motm_twin

ROOT = Path(__file__).resolve().parents[2]
TEXT = set(".py .md .toml .yaml .yml .json .lock .sh .cff .txt .urdf .css .js".split()) | {""}


def tracked() -> list[Path]:
    """Text files that git knows; outside a checkout there is nothing to ask."""
    if shutil.which("git") is None:
        pytest.skip("no git here")
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("not a git checkout")
    paths = [ROOT / name for name in listing.stdout.decode().split("\0") if name]
    return [path for path in paths if path.suffix in TEXT and path.is_file() and not path.is_symlink()]


def test_no_tracked_file_names_a_folder_of_one_machine():
    # put together from halves, so that this file does not find itself
    halves = [("/wo", "rk/"), ("/ho", "me/[a-z]"), ("/ro", "ot/"), ("/Us", "ers/[a-z]"), ("/opt/py", "pi")]
    folders = re.compile("|".join(a + b for a, b in halves))
    own = {"Dockerfile"}  # its paths are those of the image
    hits = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in tracked()
        if path.name not in own and not path.name.endswith(".tmp.md")
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1)
        if folders.search(line)
    ]
    assert not hits


def test_no_tracked_file_names_a_package_index():
    halves = [("py", r"pi\.org"), ("python", r"hosted\.org"), ("index", "-url *="), ("npm", r"js\.org")]
    hosts = re.compile("|".join(a + b for a, b in halves))
    hits = [str(path.relative_to(ROOT)) for path in tracked() if hosts.search(path.read_text(errors="replace"))]
    assert not hits


def test_the_licence_is_permissive_and_named_in_the_metadata():
    assert (ROOT / "LICENSE").read_text().startswith("MIT License")
    assert re.search(r'^license = "MIT', (ROOT / "pyproject.toml").read_text(), re.M)


def test_meshes_of_others_have_their_licence_beside_them():
    meshes = {path.parent for path in (ROOT / "web_assets").rglob("*.glb") if "panda" in str(path).lower()}
    for folder in meshes:
        near = [*folder.iterdir(), *folder.parent.iterdir()]
        assert any("LICENSE" in path.name.upper() for path in near), folder.relative_to(ROOT)


def test_the_citation_names_the_authors_of_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert str(citation["version"]) == motm_twin.__version__
    assert {"message", "title", "authors"} <= set(citation)
    paper = citation["preferred-citation"]
    names = [author["family-names"] for author in paper["authors"]]
    assert names == ["Burgess-Limerick", "Haviland", "Lehnert", "Corke"]
    assert "2309.09393" in paper["url"]


def test_the_changelog_has_a_place_for_what_comes_next():
    text = (ROOT / "CHANGELOG.md").read_text()
    assert text.startswith("# Changelog")
    assert "## [Unreleased]" in text or f"## [{motm_twin.__version__}]" in text


@pytest.mark.parametrize("script", sorted([*(ROOT / "tools").glob("*.sh"), ROOT / ".ci" / "run"], key=str))
def test_shell_scripts_can_be_started_and_parsed(script: Path):
    assert script.stat().st_mode & 0o111, "not executable"
    subprocess.run(["bash", "-n", str(script)], check=True)
