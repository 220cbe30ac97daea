"""Sections, summary and tables of `mjrun info` say what the model does, or what a file of demonstrations holds."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pytest

from mjrun.cli.commands.info import info
from mjrun.cli.info_sections import SECTIONS, TASK_TABLES, LineSection, demonstrations_page, statistics, summary
from mjrun.cli.table_cells import ReportColumn
from mjrun.hdf5.demonstration_list import DemonstrationFileOrigin, DemonstrationList, DemonstrationListEntry
from mjrun.model.info import SECTIONS as DESCRIBED
from mjrun.model.info import ModelDescription
from tests.cases import cases, mjcf
from tests.demonstration_files import PLAIN, recorded_states, write_demonstrations

MODEL = mjcf("sections")


def table(section: str, text: str = MODEL, path: Path | None = None) -> dict[str, ReportColumn]:
    """The columns of a section by their headings."""
    model = mujoco.MjModel.from_xml_string(text) if path is None else mujoco.MjModel.from_xml_path(str(path))
    table_section = SECTIONS[section]
    assert not isinstance(table_section, LineSection)
    rows = ModelDescription(model, path).section(section)
    columns = table_section.columns(rows, model)
    assert all(len(column.cells) in (0, len(rows)) for column in columns)
    return {column.heading: column for column in columns}


def test_every_section_of_a_description_is_shown_in_the_same_order() -> None:
    assert tuple(SECTIONS) == DESCRIBED


def test_help_lists_every_section() -> None:
    models, _, tasks = (info.help or "").partition("Sections: ")[2].partition("Sections of a task: ")
    assert re.findall(r"\w+", models) == [*SECTIONS]
    assert re.findall(r"\w+", tasks) == ["task", *TASK_TABLES]


@pytest.mark.parametrize("name", [name for name, section in SECTIONS.items() if not isinstance(section, LineSection)])
def test_a_model_without_objects_has_empty_tables(name: str) -> None:
    assert name == "bodies" or not any(any(column.cells) for column in table(name, "<mujoco/>").values())


@cases("section, cells")
def test_tables_say_what_the_source_says(section: str, cells: dict[str, list[str]]) -> None:
    columns = table(section)
    assert {heading: list(columns[heading].cells) for heading in cells} == cells


@cases("section, heading, unit")
def test_a_column_has_the_units_of_what_it_shows(section: str, heading: str, unit: str) -> None:
    assert table(section)[heading].unit == unit


def test_the_kind_of_target_stands_with_each_where_it_differs() -> None:
    text = MODEL.replace("</actuator>", '<adhesion name="stick" body="a" ctrlrange="0 1"/></actuator>')
    assert table("actuators", text)["acts on"].cells == ["joint/turn", "joint/turn", "body/a"]


def test_settings_show_their_value_beside_their_default() -> None:
    path, value, default, _ = (column.cells for column in table("options").values())
    rows = dict(zip(path, zip(value, default, strict=True), strict=True))
    assert rows == {"opt.gravity": ("0 0 -1", "0 0 -9.81"), "opt.integrator": ("rk4", "euler")}


def test_files_of_assets_are_relative_to_the_model(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="meshes/a.obj"/></asset>'
        '<worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    )
    columns = table("assets", path=path)
    index = list(columns["kind"].cells).index("mesh")
    assert columns["name"].cells[index] == "m"
    assert columns["file, from the model's folder"].cells[index] == str(Path("meshes/a.obj"))
    assert "4 vertices" in columns["content"].cells[index]


def test_assets_are_news_only_if_there_are_files_beside_the_models_own() -> None:
    section = SECTIONS["assets"]
    assert not isinstance(section, LineSection)
    assert not section.is_news(ModelDescription(mujoco.MjModel.from_xml_string("<mujoco/>")).assets)


if TYPE_CHECKING:
    from tests.conftest import Command


def test_the_page_lists_the_demonstrations_and_a_command_for_one(mjrun_here: Command) -> None:
    images = {"agentview_image": np.zeros((5, 2, 2, 3), np.uint8)}
    write_demonstrations(mjrun_here.folder / "d.hdf5", {"demo_1": recorded_states()}, observations=images)
    done = mjrun_here("info", "d.hdf5")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode().splitlines() == [
        "d.hdf5",
        "  task          Lift",
        "  made with     robosuite 1.4.1",
        "  control rate  20 Hz",
        "  cameras       agentview",
        "",
        "demonstrations  1",
        "  name    states  duration  images",
        "                       [s]",
        "  demo_1       5       0.2  agentview_image",
        "",
        "mjrun video d.hdf5:demo_1 --camera agentview",
    ]
    document = json.loads(mjrun_here("info", "d.hdf5", "--json").stdout)
    assert document["demonstrations"][0]["images"] == ["agentview_image"]


def test_texts_in_the_file_are_cleaned() -> None:
    hostile = "\x1b]0;owned\x07"
    episode = DemonstrationListEntry(hostile, 1, None, hostile, None, [hostile])
    origin = DemonstrationFileOrigin(hostile, hostile, hostile, hostile)
    page = demonstrations_page(DemonstrationList("d.hdf5", origin, [hostile], {hostile: 1}, [episode]))
    assert "\x1b" not in page
    assert page.count(r"\x1b]0;owned\x07") >= 7


@cases("line, code, message")
def test_mistakes_are_answered(mjrun_here: Command, line: str, code: int, message: str) -> None:
    write_demonstrations(mjrun_here.folder / "d.hdf5")
    done = mjrun_here(*line.split())
    assert (done.returncode, message in done.stderr.decode()) == (code, True)
    assert not (mjrun_here.folder / "t.csv").exists()


def test_a_corrected_copy_of_a_model_replays_the_states(mjrun_here: Command) -> None:
    old = PLAIN.replace("<visual>", '<option collision="all"/><visual>')
    write_demonstrations(mjrun_here.folder / "d.hdf5", model=old)
    done = mjrun_here("trace", "d.hdf5:demo_1", "-o", "t.csv")
    assert (done.returncode, b"`mjrun info d.hdf5:demo_1 --xml > fixed.xml` writes its MJCF" in done.stderr) == (
        3,
        True,
    )
    (mjrun_here.folder / "fixed.xml").write_bytes(mjrun_here("info", "d.hdf5:demo_1", "--xml").stdout)
    assert mjrun_here("check", "fixed.xml", "--fix", "--fail-on", "error").returncode == 0
    done = mjrun_here("trace", "fixed.xml", "--replay", "d.hdf5:demo_1", "--rate", "20", "-o", "t.csv")
    assert done.returncode == 0, done.stderr
    assert len((mjrun_here.folder / "t.csv").read_text().splitlines()) == 6


def test_a_file_is_exported_as_a_dataset(mjrun_here: Command) -> None:
    write_demonstrations(mjrun_here.folder / "d.hdf5")
    done = mjrun_here("export", "d.hdf5", "--jobs", "1", "--json", "-o", "set")
    assert done.returncode == 0, done.stderr
    assert {"episodes": 2, "rows": 9, "format": "lerobot"}.items() <= json.loads(done.stdout).items()
    assert b"d.hdf5:demo_1 does not state its version of MuJoCo" in done.stderr
    manifest = mjrun_here.folder / "set/mjrun/dataset.json"
    made = json.loads(manifest.read_bytes())["episodes"]
    assert [each["demonstration"] for each in made] == ["d.hdf5:demo_1", "d.hdf5:demo_2"]
    assert mjrun_here("export", "d.hdf5", "--jobs", "1", "-o", "set").returncode == 0
    assert json.loads(manifest.read_bytes())["episodes"] == made


def test_documents_name_demonstrations_relative_to_themselves(mjrun_here: Command) -> None:
    (mjrun_here.folder / "inner").mkdir()
    write_demonstrations(mjrun_here.folder / "inner/d.hdf5")
    document = "{model: d.hdf5:demo_1, replay: d.hdf5:demo_2, traces: [{output: t.csv, rate: 20}]}"
    (mjrun_here.folder / "inner/run.yaml").write_text(document)
    done = mjrun_here("run", "inner/run.yaml", "-o", "out")
    assert done.returncode == 0, done.stderr
    assert len((mjrun_here.folder / "out/t.csv").read_text().splitlines()) == 5
    printed = mjrun_here("trace", "inner/d.hdf5:demo_1", "-o", "t.csv", "--print-document").stdout.decode()
    assert "model: inner/d.hdf5:demo_1" in printed


TEXT = """
<mujoco>
  <option timestep=".005" gravity="0 0 -1"/>
  <worldbody>
    <body pos="1 0 0"><joint/><geom size=".1" mass="3"/></body>
    <body pos="-1 0 0"><geom size=".1" mass="3"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TEXT)


def test_the_summary_has_mujocos_own_numbers(model: mujoco.MjModel) -> None:
    lines = dict(summary(ModelDescription(model).summary))
    assert lines["mass"] == f"{mujoco.mj_getTotalmass(model):g} kg" == "6 kg"
    assert lines["centre of mass"] == "0 0 0 m"
    assert lines["timestep"] == "0.005 s, euler integrator"
    assert lines["gravity"] == "0 0 -1 m/s²"
    assert lines["compiled by"] == f"MuJoCo {mujoco.mj_versionString()}"


def test_sizes_that_are_zero_are_left_out_but_those_that_everybody_asks_for(model: mujoco.MjModel) -> None:
    lines = dict(summary(ModelDescription(model).summary))
    assert lines["state"] == "nq=1  nv=1  na=0  nu=0"
    assert lines["objects"].startswith("nbody=3")
    assert "ncam" not in lines["objects"]
    assert "=0" not in lines["objects"]


def test_statistics_are_those_of_the_model_with_units(model: mujoco.MjModel) -> None:
    lines = dict(statistics(ModelDescription(model).statistics))
    assert lines["extent"] == f"{model.stat.extent:.5g} m"
    assert lines["meaninertia"] == f"{model.stat.meaninertia:.5g} kg·m²"
    assert list(lines) == ["center", "extent", "meansize", "meanmass", "meaninertia"]
