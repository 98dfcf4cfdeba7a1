"""Scenes by name or file: find, read, extend, lay the variant over it, resolve and check; list what is shipped.

The format is documented in ``docs/scenes.md``; its types are in ``scene_format.py``.
"""

import dataclasses
import difflib
import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from numbers import Integral
from pathlib import Path

import msgspec

from motm_twin.model.assets import scenes_dir
from motm_twin.model.bounds import SEED
from motm_twin.model.names import SceneError, hint
from motm_twin.model.scene import Scene
from motm_twin.model.scene_check import check_scene
from motm_twin.model.scene_format import FORMAT, SceneFile
from motm_twin.model.scene_resolve import Resolver
from motm_twin.model.scene_yaml import MAX_BYTES, Node, check_types, parse_yaml, show

MAKERS = {  # prefix of a name: module with `made`, imported for such a scene
    "generated:": "motm_twin.generate.scenes",
    **dict.fromkeys(("barn:", "circle:", "square:", "dynabarn:"), "motm_twin.generate.challenges"),
}
_ENDINGS = (".yaml", ".yml")
_MAX_EXTENDS = 4
_BY_NAME = ("furniture", "slots", "objects", "bins", "bumps", "agents", "variants")
_BY_KEY = ("robot", "noise", "mismatch", "faults", "deliver")
_NOT_INHERITED = ("format", "extends", "title")


@dataclasses.dataclass(frozen=True)
class Document:
    """A scene file with everything it extends merged in; types are checked."""

    name: str
    file: str  # its name in messages
    root: Node

    def variants(self) -> list[str]:
        """Names of the variants, in the order of the file."""
        node = self.root.value.get("variants")
        return [] if node is None else list(node.value)


def shipped_names() -> list[str]:
    """Names of the shipped scenes."""
    return sorted(path.stem for path in scenes_dir().glob("*.yaml"))


def strangers_names() -> list[str]:
    """Names of scenes by people who did not know the controller, for `motm-twin bench strangers`; not listed."""
    return sorted(f"strangers/{path.stem}" for path in (scenes_dir() / "strangers").glob("*.yaml"))


def find_scene(name_or_path: str) -> tuple[Path, str]:
    """The file of a shipped name or a path, and its name in messages."""
    text = str(name_or_path)
    names = shipped_names()
    if text in names or text in strangers_names():
        return scenes_dir() / f"{text}.yaml", f"scenes/{text}.yaml"
    path = Path(text)
    if text and _answers(path.is_dir):
        raise SceneError("it is a folder: name a scene file in it", file=show(text))
    looks_like_path = text.endswith(_ENDINGS) or path.name != text
    if _answers(path.is_file):
        if not text.endswith(_ENDINGS):
            raise SceneError("a scene file ends with .yaml or .yml: rename it", file=text)
        return path, text
    if looks_like_path:
        close = difflib.get_close_matches(path.stem, names, n=1)
        shipped = f"; the shipped scene '{close[0]}' is called without folder and ending" if close else ""
        raise SceneError(f"there is no such scene file{shipped}", file=show(text))
    raise SceneError(
        f"no scene is called {show(text)} (a path to your own .yaml file works too, generated:SEED and barn:SEED); "
        f"{hint(text, names)}"
    )


def _answers(question: Callable[[], bool]) -> bool:
    try:
        return question()
    except (OSError, ValueError):  # a name that is too long, or contains a null character
        return False


def load_document(name_or_path: str) -> Document:
    """Read a scene file and everything that it extends, or make a scene from a seed. Raises SceneError."""
    if is_made(name_or_path):
        return _made(name_or_path)
    path, shown = find_scene(name_or_path)
    return Document(path.stem, shown, _extended(_read(path, shown), path, shown, (path.resolve(),)))


def text_document(raw: bytes, name: str) -> Document:
    """The document of a scene given as text; it may extend scenes that are shipped or in the working folder."""
    path = Path(f"{name}.yaml")
    return Document(name, name, _extended(_parsed(raw, name), path, name, (path.resolve(),)))


def is_made(name: str) -> bool:
    """True when the scene is made from a seed: it has no file."""
    return name.startswith(tuple(MAKERS))


def _made(asked: str) -> Document:
    maker = next(module for prefix, module in MAKERS.items() if asked.startswith(prefix))
    name, text = importlib.import_module(maker).made(asked)
    root = parse_yaml(text, name)
    check_types(root, SceneFile)
    return Document(name, name, merge(Node({}, name, root.line, ""), root))


def _extended(root: Node, path: Path, shown: str, seen: tuple[Path, ...]) -> Node:
    """The tree merged over everything that it extends."""
    extends = root.value.get("extends")
    if extends is None or extends.value is None:
        return merge(Node({}, root.file, root.line, ""), root)
    base, base_shown = _find_base(extends, path, shown)
    if base.resolve() in seen:
        raise extends.error(f"'{extends.value}' extends this file in turn: break the circle")
    if len(seen) > _MAX_EXTENDS:
        raise extends.error(f"more than {_MAX_EXTENDS} files extend one another")
    inherited = _extended(_read(base, base_shown), base, base_shown, (*seen, base.resolve()))
    kept = {key: node for key, node in inherited.value.items() if key not in _NOT_INHERITED}
    return merge(Node(kept, root.file, root.line, ""), root)


def _read(path: Path, shown: str) -> Node:
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise SceneError(f"cannot be read: {error.strerror}", file=shown) from error
    return _parsed(raw, shown)


def _parsed(raw: bytes, shown: str) -> Node:
    if len(raw) > MAX_BYTES:
        raise SceneError("larger than 1 MiB: a scene is a short text", file=shown)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise SceneError("not UTF-8 text: save the file as UTF-8", file=shown, line=line) from error
    root = parse_yaml(text, shown)
    if not isinstance(root.value, dict):
        raise root.error(f"a scene is a mapping that begins with 'format: {FORMAT}', got {show(root.value)}")
    if "format" not in root.value:
        raise root.error(f"the key 'format' is missing: write 'format: {FORMAT}'")
    check_types(root, SceneFile)
    return root


def _find_base(extends: Node, path: Path, shown: str) -> tuple[Path, str]:
    name = extends.value
    stem = name[: -len(".yaml")] if name.endswith(".yaml") else name
    if Path(stem).name != stem or "\\" in stem or stem in (".", "..") or "\0" in stem:
        raise extends.error(f"'{name}' leaves the folder: give a shipped scene's name or a file in the same folder")
    beside = path.parent / f"{stem}.yaml"
    if beside.is_file():
        if beside.resolve().parent != path.resolve().parent:
            raise extends.error(f"'{name}' is a link that leaves the folder: copy the file here")
        return beside, shown[: len(shown) - len(Path(shown).name)] + beside.name
    if stem in shipped_names():
        return scenes_dir() / f"{stem}.yaml", f"scenes/{stem}.yaml"
    others = [other.stem for other in sorted(path.parent.glob("*.yaml")) if other != path]
    raise extends.error(f"there is no scene '{name}'; {hint(stem, sorted({*shipped_names(), *others}))}")


def merge(base: Node, over: Node) -> Node:
    """The sections of one tree laid over those of another: named entries by name, settings by key, others whole."""
    merged = dict(base.value)
    for given, other in (("tasks", "deliver"), ("deliver", "tasks")):
        if given in over.value and over.value[given].value is not None and other not in over.value:
            merged.pop(other, None)
    for key, node in over.value.items():
        below = merged.get(key)
        if key in _BY_NAME:
            merged[key] = _merge_named(below, node)
        elif key in _BY_KEY and below is not None:
            merged[key] = _merge_keys(below, node)
        else:
            merged[key] = node
        if merged[key].value is None:
            del merged[key]
    return Node(merged, over.file, over.line, over.place)


def _merge_named(below: Node | None, over: Node) -> Node:
    entries = {} if below is None else dict(below.value)
    for name, node in over.value.items():
        if node.value is not None:
            entries[name] = node
        elif name in entries:
            del entries[name]
        else:
            raise node.error(f"nothing is called '{name}' here that could be removed; {hint(name, entries)}")
    return Node(entries, over.file, over.line, over.place)


def _merge_keys(below: Node, over: Node) -> Node:
    if not (isinstance(below.value, dict) and isinstance(over.value, dict)):
        return over
    entries = dict(below.value)
    for key, node in over.value.items():
        entries[key] = _merge_keys(entries[key], node) if key in entries else node
    return Node(entries, over.file, over.line, over.place)


def with_variant(document: Document, variant: str | None) -> tuple[Node, str]:
    """The tree of one variant (None: the default one), and the variant's name ("" when the scene has none)."""
    names = document.variants()
    default = document.root.value.get("default_variant")
    if default is not None and default.value not in names:
        raise default.error(f"there is no variant '{default.value}'; {hint(default.value, names)}")
    first = names[0] if names else ""
    chosen = variant if variant is not None else first if default is None else default.value
    if chosen and chosen not in names:
        where = hint(chosen, names) if names else "the scene has no variants"
        raise SceneError(f"there is no variant {show(chosen)}; {where}", file=document.file)
    base = Node({k: n for k, n in document.root.value.items() if k != "variants"}, document.file, 1, "")
    if not chosen:
        return base, ""
    return merge(base, document.root.value["variants"].value[chosen]), chosen


class SceneListing(msgspec.Struct, frozen=True, kw_only=True):
    """Name, title and variants of a scene, for choosing one."""

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
    return scene_of(load_document(name_or_path), variant, seed)


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
    """Every variant of a scene, resolved and checked. Raises SceneError for the first invalid one."""
    return check_document(load_document(name_or_path))


def check_document(document: Document) -> tuple[Scene, ...]:
    """Every variant of a document, resolved and checked. Raises SceneError for the first invalid one.

    Slots that another seed would draw are checked, too.
    """
    scenes = []
    for variant in document.variants() or [None]:
        scenes.append(scene_of(document, variant, None))
        root, chosen = with_variant(document, variant)
        with _naming(document, chosen):
            for slots in Resolver(root, None).draws():
                check_scene(Resolver(root, None, slots).scene(document.name, chosen), root)
    return tuple(scenes)


def scene_of(document: Document, variant: str | None, seed: int | None) -> Scene:
    """One variant of a document, resolved and checked, as `load_scene` does it. Raises SceneError."""
    if seed is not None and (not isinstance(seed, Integral) or SEED.refusal("seed", seed)):
        raise SceneError(f"the seed must be a whole number from 0 to 2^63 - 1, got {seed!r}", file=document.file)
    root, chosen = with_variant(document, variant)
    with _naming(document, chosen):
        scene = Resolver(root, seed).scene(document.name, chosen)
        check_scene(scene, root)
    return scene


@contextmanager
def _naming(document: Document, variant: str) -> Iterator[None]:
    """Add the variant to a refusal, unless its place names it or the scene without variants is refused too."""
    try:
        yield
    except SceneError as error:
        if not variant or error.place.startswith(f"variants.{variant}.") or str(error) == _problem_alone(document):
            raise
        problem = f"{error.problem} (in the variant '{variant}')"
        raise SceneError(problem, file=error.file, line=error.line, place=error.place) from error


def _problem_alone(document: Document) -> str:
    """The refusal of a scene without its variants."""
    kept = {key: node for key, node in document.root.value.items() if key not in ("variants", "default_variant")}
    try:
        scene_of(dataclasses.replace(document, root=dataclasses.replace(document.root, value=kept)), None, None)
    except SceneError as error:
        return str(error)
    return ""
