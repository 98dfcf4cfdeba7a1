"""Scenes by name or file: load one variant, list what is shipped.

The format is documented in ``docs/scenes.md``; its types are in ``scene_format.py``.
"""

from numbers import Integral

import msgspec

from motm_twin.model.bounds import SEED
from motm_twin.model.scene import Scene
from motm_twin.model.scene_check import check_scene
from motm_twin.model.scene_error import SceneError
from motm_twin.model.scene_load import Document, load_document, shipped_names, with_variant
from motm_twin.model.scene_resolve import Resolver

__all__ = ["SceneError", "SceneListing", "check_all", "list_scenes", "load_scene"]


class SceneListing(msgspec.Struct, frozen=True, kw_only=True):
    """Name, title and variants, to choose a scene by."""

    name: str
    title: str
    variants: tuple[str, ...]
    default_variant: str


def load_scene(name_or_path: str, variant: str | None = None, seed: int | None = None) -> Scene:
    """Load one variant of a shipped scene or of your own file, resolved and checked.

    Args:
        name_or_path: Name of a shipped scene, path of a .yaml file, ``generated:SEED@DIFFICULTY`` or ``barn:SEED``.
        variant: Named variant; None: the scene's default.
        seed: Seed of noise and random arrangements; None: the seed of the file.

    Raises:
        SceneError: The scene, variant or seed cannot be used; the message says why and what to do.
    """
    return _resolve(load_document(name_or_path), variant, seed)


def list_scenes() -> tuple[SceneListing, ...]:
    """The shipped scenes."""
    return tuple(listing(load_document(name)) for name in shipped_names())


def listing(document: Document) -> SceneListing:
    """Name, title and variants of a scene file."""
    _, default = with_variant(document, None)
    title = document.root.value.get("title")
    return SceneListing(
        name=document.name,
        title=document.name if title is None else title.value,
        variants=tuple(document.variants()),
        default_variant=default,
    )


def check_all(name_or_path: str) -> tuple[Scene, ...]:
    """Every variant of a scene, resolved and checked; raises SceneError for the first that is wrong."""
    return check_document(load_document(name_or_path))


def check_document(document: Document) -> tuple[Scene, ...]:
    """The same of a document."""
    return tuple(_resolve(document, variant, None) for variant in document.variants() or [None])


def _resolve(document: Document, variant: str | None, seed: int | None) -> Scene:
    if seed is not None and (not isinstance(seed, Integral) or SEED.refusal("seed", seed)):
        raise SceneError(f"the seed must be a whole number from 0 to 2^63 - 1, got {seed!r}", file=document.file)
    root, chosen = with_variant(document, variant)
    resolver = Resolver(root, seed)
    scene = resolver.scene(document.name, chosen)
    check_scene(scene, root)
    return scene
