from motm_twin.model.names import hint


def test_a_near_miss_is_asked_about_and_anything_else_gets_the_full_list():
    assert hint("cub1", ["cube1", "table"]) == "did you mean cube1?"
    assert hint("cube", ["cube1", "cube2"]) in ("did you mean cube1 or cube2?", "did you mean cube2 or cube1?")
    assert hint("xyz", ["cube1", "table"]) == "there are: cube1, table"
    assert hint("", []) == "there are: none"
    assert hint("cube1" * 10_000, ["cube1"]) == "there are: cube1"
