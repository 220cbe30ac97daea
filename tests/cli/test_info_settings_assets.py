"""Tables of options, plugins and assets."""

from pathlib import Path

import mujoco

from mjrun.cli.info_settings_assets import assets, plugins, settings
from mjrun.model.description.model_description import ModelDescription

ROOT = Path(__file__).parents[2]


def test_settings_show_their_value_beside_their_default() -> None:
    model = mujoco.MjModel.from_xml_string('<mujoco><option gravity="0 0 -1" integrator="RK4"/></mujoco>')
    path, value, default, _ = (column.cells for column in settings(ModelDescription(model).options))
    rows = dict(zip(path, zip(value, default, strict=True), strict=True))
    assert rows["opt.gravity"] == ("0 0 -1", "0 0 -9.81")
    assert rows["opt.integrator"] == ("rk4", "euler")


def test_files_of_assets_are_relative_to_the_model(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="meshes/a.obj"/></asset>'
        '<worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    )
    rows = ModelDescription(mujoco.MjModel.from_xml_path(str(path)), path).assets
    columns = {column.heading: list(column.cells) for column in assets(rows)}
    index = columns["kind"].index("mesh")
    assert columns["name"][index] == "m"
    assert columns["file, from the model's folder"][index] == str(Path("meshes/a.obj"))
    assert "4 vertices" in columns["content"][index]


def test_a_model_without_plugins_has_an_empty_table() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert [list(column.cells) for column in plugins(ModelDescription(model).plugins)] == [[]] * 5
