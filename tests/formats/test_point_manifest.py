"""Values of points in words."""

import json
from pathlib import Path

from mjrun.formats.point_manifest import NAME, point_values, read_point, values_in_words


def test_values_have_the_shortest_names_that_tell_them_apart() -> None:
    values = {"opt.timestep": "0.0100000", "geom/floor.friction[0]": "0.123456", "geom/ball.friction[0]": "2"}
    assert values_in_words(values) == ["timestep 0.01", "floor.friction[0] 0.1235", "ball.friction[0] 2"]
    assert values_in_words({"model": "models/car.xml", "seed": "3"}) == ["model car", "seed 3"]
    assert values_in_words({"model": "models/arm.urdf", "ctrl_from": "a/b.csv"}) == ["model arm", "ctrl_from a/b.csv"]
    assert values_in_words({"qpos/hip": "1", "qvel/hip": "2"}) == ["qpos/hip 1", "qvel/hip 2"]


def test_a_manifest_that_is_not_there_or_broken_tells_nothing(tmp_path: Path) -> None:
    assert read_point(tmp_path) == {}
    (tmp_path / NAME).write_text("[1")
    assert point_values(tmp_path) == {}
    (tmp_path / NAME).write_text(json.dumps({"values": {"seed": "3"}}))
    assert point_values(tmp_path) == {"seed": "3"}
