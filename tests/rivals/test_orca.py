"""orca: velocity obstacles tracked by a differential drive."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.methods.registry import find_method
from motm_twin.model.names import MethodError
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import DriveTo
from motm_twin.model.scene_file import load_scene
from motm_twin.rivals.orca import effective_radius, twist_of
from motm_twin.trial import run_scene


def test_the_effective_centre_goes_at_the_wanted_velocity():
    for heading in (0.0, 0.7, -2.0):
        for velocity in ((0.3, 0.1), (-0.2, 0.4)):
            v, w = twist_of(np.array(velocity), heading, 0.15)
            c, s = math.cos(heading), math.sin(heading)
            assert (v * c - 0.15 * w * s, v * s + 0.15 * w * c) == pytest.approx(velocity)


def test_the_disc_about_the_effective_centre_holds_the_footprint():
    foot = Footprint(length=0.7, width=0.5, offset_x=0.05)
    radius = effective_radius(foot, 0.15)
    corners = [(0.05 + x, y) for x in (-0.35, 0.35) for y in (-0.25, 0.25)]
    assert max(math.dist(corner, (0.15, 0.0)) for corner in corners) == pytest.approx(radius)


def test_it_crosses_an_empty_hall_to_a_pose_and_a_circle_of_people_that_see_it():
    crowd = load_scene("circle:0")
    hall = msgspec.structs.replace(crowd, agents=(), tasks=(DriveTo(point=(0.0, 4.0), heading=0.0, tolerance=0.15),))
    for scene, limit in ((hall, 14.0), (crowd, 20.0)):
        report = run_scene(scene, method=find_method("orca"))
        assert report["success"], report["reason"]
        assert report["contacts"] == []
        assert report["time_s"] < limit


def test_without_pyrvo_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr("motm_twin.model.rvo.find_spec", lambda name: None)
    with pytest.raises(MethodError, match=r'pip install "motm_twin\[people\]"'):
        run_scene(msgspec.structs.replace(load_scene("circle:0"), agents=()), method=find_method("orca"))
