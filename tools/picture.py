"""Take the pictures of README and docs, or the references that a test compares the page with.

Usage: python tools/picture.py [NAME ...]            pictures of docs/ (all, or those named)
       python tools/picture.py --references [NAME]   pictures of tests/ui/pictures
Needs the dev extra and a Chromium. Look at every picture before you commit it.
"""

import argparse
import io
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "ui"))

import picture_docs  # noqa: E402 - beside this file
import states  # noqa: E402 - tests/ui
from page import chromium, serving  # noqa: E402 - tests/ui

LEVELS = 8  # grey levels that are one in a reference: half the bytes


def main() -> int:
    """Take what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--references", action="store_true", help="those that a test compares the page with")
    options = parser.parse_args()
    table = states.STATES if options.references else picture_docs.PICTURES
    folder = states.FOLDER if options.references else ROOT / "docs"
    size = states.SIZE if options.references else picture_docs.SIZE
    unknown = [name for name in options.names if name not in table]
    if unknown:
        parser.error(f"unknown picture {unknown[0]!r}: there are {', '.join(table)}")
    with chromium() as browser:
        for scene, names in by_scene(table, options.names).items():
            with serving(*scene) as twin:
                visitor = states.visitor(browser, twin, size)
                for name in names:
                    table[name].show(visitor)
                    save(states.screenshot(visitor), folder / f"{name}.png", small=options.references)
                visitor.page.close()
    return 0


def by_scene(table: dict[str, states.State], wanted: list[str]) -> dict[tuple[str, ...], list[str]]:
    """Names of pictures by what is served for them."""
    found: dict[tuple[str, ...], list[str]] = {}
    for name, state in table.items():
        if not wanted or name in wanted:
            found.setdefault(state.scene, []).append(name)
    return found


def save(picture: Image.Image, path: Path, *, small: bool) -> None:
    """Write it with few bytes, and say how many."""
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    if small:
        picture = picture.point([level // LEVELS * LEVELS + LEVELS // 2 for level in range(256)] * 3)
    picture.save(buffer, "PNG", optimize=True)
    path.write_bytes(buffer.getvalue())
    print(f"{path.relative_to(ROOT)}: {len(buffer.getvalue()) / 1000:.0f} kB")


if __name__ == "__main__":
    sys.exit(main())
