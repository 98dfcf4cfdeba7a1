"""The wheel: it carries scenes and assets, and works from any directory."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (built,) = out.glob("motm_twin-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("installed")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


def run_away_from_home(installed: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the installed package from an empty folder; the environment gives only its dependencies."""
    environment = os.environ | {"PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1"}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_the_wheel_carries_every_scene_and_asset(wheel: Path):
    names = set(zipfile.ZipFile(wheel).namelist())
    for folder in ("scenes", "web_assets"):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and not path.name.startswith(".") and "__pycache__" not in path.parts:
                assert f"motm_twin/{path.relative_to(ROOT)}" in names


def test_the_wheel_carries_no_tests_and_no_top_level_folders_but_its_own(wheel: Path):
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert all(top == "motm_twin" or top.endswith(".dist-info") for top in tops)


def test_the_wheel_carries_no_compiled_leftovers(wheel: Path):
    leftovers = (".pyc", ".nbi", ".nbc")
    assert not [name for name in zipfile.ZipFile(wheel).namelist() if name.endswith(leftovers)]


def test_an_installed_package_finds_its_own_scenes_and_assets(installed: Path, tmp_path: Path):
    code = (
        "import motm_twin; from motm_twin.model.assets import scenes_dir, web_assets_dir; "
        "print(motm_twin.__file__); print(scenes_dir()); print(web_assets_dir())"
    )
    done = run_away_from_home(installed, tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    package, scenes, assets = (Path(line) for line in done.stdout.split("\n")[:3])
    assert package.parent == installed / "motm_twin"
    assert scenes == installed / "motm_twin" / "scenes"
    assert assets == installed / "motm_twin" / "web_assets"


def test_an_installed_package_lists_the_shipped_scenes_from_any_directory(installed: Path, tmp_path: Path):
    done = run_away_from_home(installed, tmp_path, "-c", "from motm_twin.cli import main; main()", "scene", "list")
    assert done.returncode == 0, done.stderr
    for name in ("exp1", "exp1a", "exp2", "playground"):
        assert name in done.stdout.split()
