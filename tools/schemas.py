"""Write docs/schemas/*.json from the types in the code. The tables of docs/zenoh.md: tools/zenoh_page.py.

    .venv/bin/python tools/schemas.py [--check]

A schema that does not fit what was published under its version is not written: give it a new version first. With
--check nothing is written, and the exit code is 1 when something would be.
"""

import argparse
import json
import sys
from pathlib import Path

from motm_twin.bus.schemas import MESSAGES, PLANT_MESSAGES, breaking_changes, file_name, schema

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "schemas"
PUBLISHED = (*MESSAGES, *PLANT_MESSAGES)


def text_of(name: str) -> str:
    """The schema of a message as the text of its file."""
    return json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"


def problems(folder: Path = FOLDER) -> list[str]:
    """Why files can not be written: what breaks the promise of a version."""
    found = []
    for name in PUBLISHED:
        path = folder / file_name(name)
        if path.exists():
            breaks = breaking_changes(json.loads(path.read_text(encoding="utf-8")), schema(name))
            found += [f"{schema(name)['$id']} {line}: bump the version of {name!r}" for line in breaks]
    return found


def wanted() -> dict[Path, str]:
    """Contents that every generated file should have."""
    return {FOLDER / file_name(name): text_of(name) for name in PUBLISHED}


def main() -> int:
    """Write, or check; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    if found := problems():
        print("\n".join(found), file=sys.stderr)
        return 1
    (FOLDER / "plant").mkdir(parents=True, exist_ok=True)
    other = [path for path, text in wanted().items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in other:
        print(f"{'differs' if check else 'written'}: {path.relative_to(ROOT)}")
        if not check:
            path.write_text(wanted()[path], encoding="utf-8")
    return 1 if check and other else 0


if __name__ == "__main__":
    sys.exit(main())
