"""Folders of shipped assets and scenes: beside the package in a checkout, inside it when installed from a wheel."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def _shipped(name: str) -> Path:
    for folder in (_PACKAGE / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"{name}/ is neither in {_PACKAGE} nor beside it: reinstall motm_twin")


def web_assets_dir() -> Path:
    """Folder of URDF, meshes and licences."""
    return _shipped("web_assets")


def scenes_dir() -> Path:
    """Folder of the shipped scenes."""
    return _shipped("scenes")
