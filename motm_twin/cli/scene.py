"""The commands ``motm-twin scene list | check | schema | generate``. Each returns 0, or 2 for bad input."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from motm_twin.generate.scenes import DIFFICULTY, generate
from motm_twin.model.names import SceneError
from motm_twin.model.scene import Scene
from motm_twin.model.scene_doubts import doubts, variant_doubts
from motm_twin.model.scene_file import check_document, load_document, scene_of, text_document
from motm_twin.model.scene_file import list_scenes as shipped_scenes
from motm_twin.model.scene_format import json_schema
from motm_twin.program import BAD_INPUT, OK

_MANY = 6


def list_scenes() -> int:
    """Print name, title and variants of the shipped scenes."""
    try:
        scenes = shipped_scenes()
    except SceneError as error:
        return _refuse(error)
    width = max(len(scene.name) for scene in scenes)
    for scene in scenes:
        print(f"{scene.name:<{width}}  {scene.title}")
        names = [f"{name} (default)" if name == scene.default_variant else name for name in scene.variants]
        if names:
            print(f"{'':<{width}}  variants: {', '.join(names)}")
    return OK


def check_scenes(names_or_paths: Sequence[str]) -> int:
    """Check scenes one by one; bad input if any of them is invalid."""
    return max([_check(name) for name in names_or_paths])


def _check(name_or_path: str) -> int:
    """Check every variant of a scene; print its content and doubts, or the first error; "-": standard input."""
    try:
        if name_or_path == "-":
            document = text_document(sys.stdin.buffer.read(), "standard input")
        else:
            document = load_document(name_or_path)
        scenes, doubted = check_document(document), doubts(document)
    except SceneError as error:
        return _refuse(error)
    first = scenes[0]
    variants = [scene.variant for scene in scenes if scene.variant]
    shown = ", ".join(variants[:_MANY]) + (", ..." if len(variants) > _MANY else "")
    print(f"{first.name}: good. {first.title}")
    print(
        f"{len(first.solids)} pieces of furniture, {len(first.objects)} objects, {len(first.bins)} bins, "
        f"{len(first.agents)} agents, {len(first.tasks)} tasks; robot {first.robot.name}"
    )
    if variants:
        print(f"{len(variants)} variants: {shown}")
    for doubt in doubted:
        print(f"doubt: {doubt}")
    return OK


def load_with_doubts(name_or_path: str, variant: str | None, seed: int | None) -> Scene:
    """`load_scene`, with the doubts about the scene printed to standard error."""
    document = load_document(name_or_path)
    scene = scene_of(document, variant, seed)
    for doubt in variant_doubts(document, variant, seed):
        print(f"doubt: {doubt}", file=sys.stderr)
    return scene


def print_schema() -> int:
    """Print the JSON Schema of the scene format."""
    print(schema_text(), end="")
    return OK


def schema_text() -> str:
    """The JSON Schema as it is published in ``docs/scene.schema.json``."""
    return json.dumps(json_schema(), indent=2, sort_keys=True) + "\n"


def generate_scene(seed: int | None, difficulty: float | None, output: Path | None, path: str | None) -> int:
    """Write a newly generated scene to a new file, or print it."""
    try:
        if path is not None:
            raise SceneError(f"scene generate makes its own scene: leave {path!r} out, or write -o {path}")
        if seed is None:
            raise SceneError("scene generate: say which one, as --seed 17")
        if output is not None and output.suffix not in (".yaml", ".yml"):
            raise SceneError("a scene file ends with .yaml or .yml: name it so", file=str(output))
        text = generate(seed, DIFFICULTY if difficulty is None else difficulty)
    except SceneError as error:
        return _refuse(error)
    if output is None:
        print(text, end="")
        return OK
    try:
        with output.open("x", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
    except FileExistsError:
        return _refuse(SceneError("it exists already: choose another name, or remove it", file=str(output)))
    except OSError as error:
        return _refuse(SceneError(f"cannot be written: {error.strerror}", file=str(output)))
    print(f"written to {output}")
    return OK


def _refuse(error: SceneError) -> int:
    print(f"error: {error}", file=sys.stderr)
    return BAD_INPUT


__all__ = ["check_scenes", "generate_scene", "list_scenes", "load_with_doubts", "print_schema", "schema_text"]
