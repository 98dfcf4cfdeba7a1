"""Whatever stands in a scene file, loading it gives a scene or a `SceneError`, never another exception."""

import copy
import json
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motm_twin.model.assets import scenes_dir
from motm_twin.model.names import SceneError
from motm_twin.model.scene_file import check_all, load_scene

TEXT = (scenes_dir() / "playground.yaml").read_text(encoding="utf-8")
TREE = yaml.safe_load(TEXT)
ODD = [
    None,
    True,
    0,
    -1,
    7,
    1.5,
    -0.01,
    1e300,
    float("nan"),
    float("inf"),
    "",
    "x",
    "2",
    "red_cube",
    [],
    [1],
    {},
    {"a": 1},
]


def places(value: Any, path: tuple = ()) -> list[tuple]:
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(inner for key, item in inside for inner in places(item, (*path, key)))]


def replaced(path: tuple, value: Any) -> Any:
    if not path:
        return value
    tree = copy.deepcopy(TREE)
    node = tree
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return tree


def load(path, text: str, read=load_scene) -> None:
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    try:
        read(str(path))
    except SceneError as error:
        assert str(error).startswith(str(path))
        assert "\n" not in str(error)


@pytest.mark.parametrize("section", sorted(TREE))
def test_an_odd_value_anywhere_is_a_scene_or_a_scene_error(tmp_path, section):
    for index, path in enumerate(place for place in places(TREE) if place and place[0] == section):
        read = check_all if section == "variants" or index % 5 == 0 else load_scene  # the default variant alone
        odd = json.dumps(replaced(path, ODD[index * 7 % len(ODD)])).replace("NaN", ".nan")
        load(tmp_path / "odd.yaml", odd, read)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(start=st.integers(0, len(TEXT)), length=st.integers(0, 40), put=st.text(max_size=6))
def test_cut_and_scribbled_text_is_a_scene_or_a_scene_error(tmp_path, start, length, put):
    load(tmp_path / "cut.yaml", TEXT[:start] + put + TEXT[start + length :])
