"""Theorems about the job that describes a model: sections are checked, values are JSON, the schema stays."""

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import mujoco
import pytest

from mjrun.document.json_schema import report_schema
from mjrun.errors import MjrunWarning, ModelNotFoundError, UnknownNameError
from mjrun.model.info import SECTIONS, Info, InfoResult, ModelDescription
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from mjrun.model.table_column import Column
from mjrun.outputs.trace import columns
from mjrun.simulation.simulation import Simulation
from tests.cases import mjcf
from tests.document.schema_oracle import fits

SCHEMA = json.loads((Path(__file__).parent / "info_schema.json").read_text("utf-8"))
SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.xml"))

# One of everything that a section can list.
WHOLE = mjcf("one_of_each")


def strict(value: Any) -> Any:
    """Through JSON that knows no NaN."""
    return json.loads(json.dumps(value, allow_nan=False))


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "whole.xml"
    path.write_text(WHOLE)
    return path


def test_the_schema_of_the_document_is_stable(whole: Path) -> None:
    document = strict(Info(whole).run().document())
    assert [*document] == [*SECTIONS, "warnings"] == [*SCHEMA, "warnings"]
    for name, expected in SCHEMA.items():
        rows = document[name] if isinstance(document[name], list) else [document[name]]
        assert rows, name
        assert all([*row] == expected for row in rows)


def test_the_document_fits_its_schema_with_any_of_its_sections(whole: Path) -> None:
    schema = report_schema("info", "mjrun info", InfoResult)
    model = mujoco.MjModel.from_xml_path(str(whole))
    model.opt.gravity[:] = math.nan, math.inf, -1
    for subject in (whole, model):
        document = strict({**Info(subject).run().document(), "schema": "mjrun-info-1"})
        assert fits(document, schema, schema)
        for name in SECTIONS:
            assert fits({key: value for key, value in document.items() if key != name}, schema, schema)
            assert not fits({**document, name: "x"}, schema, schema)
    for key in ("warnings", "schema"):
        assert not fits({name: value for name, value in document.items() if name != key}, schema, schema)


@pytest.mark.parametrize("name", [name for name in SECTIONS if name not in ("summary", "statistics")])
def test_rows_of_the_document_have_all_keys_of_their_schema(whole: Path, name: str) -> None:
    schema = report_schema("info", "mjrun info", InfoResult)
    document = strict({**Info(whole, [name]).run().document(), "schema": "mjrun-info-1"})
    (row, *_) = document[name]
    assert fits(document, schema, schema)
    for key in row:
        part = {inner: value for inner, value in row.items() if inner != key}
        assert not fits({**document, name: [part]}, schema, schema)
        assert not fits({**document, name: [{**row, key: {"x": [{}]}}]}, schema, schema)


@pytest.mark.parametrize("name", [*SECTIONS, "warnings"])
def test_the_document_has_the_sections_asked_for_once_and_in_order(whole: Path, name: str) -> None:
    if name == "warnings":
        asked, expected = ["joints", "summary", "joints"], ["joints", "summary"]
    else:
        asked = expected = [name]
    document = Info(whole, asked).run().document()
    assert [*document] == [*expected, "warnings"]
    everything = Info(whole).run().document()
    assert all(document[section] == everything[section] for section in expected)


def test_a_wrong_section_is_refused_before_the_model_is_looked_at() -> None:
    with pytest.raises(UnknownNameError, match=r"no section 'joint' \(did you mean 'joints'\?\)"):
        Info("there_is_no_such_model.xml", ["joint"]).run()
    with pytest.raises(ModelNotFoundError):
        Info("there_is_no_such_model.xml", ["joints"]).run()


def test_overrides_are_part_of_what_is_described(whole: Path) -> None:
    source = FileSource(whole, overrides=(Override("geom/g.size", ".2"), Override("opt.timestep", ".004")))
    found = Info(source, ["summary", "geoms", "options"]).run().description
    assert found.summary.timestep == 0.004
    assert next(geom.size for geom in found.geoms if geom.name == "g") == (0.2,)
    assert [(s.path, s.value) for s in found.options] == [("opt.timestep", 0.004)]


def test_a_compiled_model_is_described_as_its_file_is_but_for_the_files(whole: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(whole))
    compiled, loaded = Info(model).run().document(), Info(whole).run().document()
    assert (compiled["summary"].pop("file"), compiled.pop("assets")) == (None, [])
    assert loaded["summary"].pop("file") == str(whole)
    assert [asset["kind"] for asset in loaded.pop("assets")] == ["model"]
    assert compiled == loaded


def test_a_number_that_is_not_finite_is_null_in_the_document(whole: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(whole))
    model.opt.gravity[:] = math.nan, math.inf, -1
    document = strict(Info(model).run().document())
    assert document["summary"]["gravity"] == [None, None, -1]


def test_what_mujoco_warns_of_is_kept_and_told(tmp_path: Path) -> None:
    (tmp_path / "child.xml").write_text("""<mujoco><option timestep=".005"/><worldbody><body name="b">
        <geom size="1"/></body></worldbody></mujoco>""")
    (tmp_path / "parent.xml").write_text("""<mujoco><asset><model name="child" file="child.xml"/></asset><worldbody>
        <attach model="child" body="b" prefix="c"/></worldbody></mujoco>""")
    with pytest.warns(MjrunWarning, match="timestep: parent has 0.002"):
        result = Info(tmp_path / "parent.xml", ["summary"]).run()
    assert len(result.warnings) == 1
    assert "timestep: parent has 0.002" in result.document()["warnings"][0]


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_sensors_and_joints_have_the_units_of_their_columns(path: Path) -> None:
    found = Info(path, ["joints", "sensors"]).run().description
    for column in columns(Simulation(path)):
        assert isinstance(column, Column)
        group = column.name.partition("/")[0]
        if group == "qpos" and column.kind == "joint" and found.joints[column.id].type in ("hinge", "slide"):
            assert column.unit == found.joints[column.id].unit
        if group == "sensor" and column.unit:
            assert column.unit == found.sensors[column.id].unit


def test_the_summary_is_what_mujoco_says(scene: ModelDescription) -> None:
    model, found = scene.model, scene.summary
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert found.mass == mujoco.mj_getTotalmass(model)
    weights = model.body_mass / model.body_mass.sum()
    assert found.centre_of_mass == pytest.approx(weights @ data.xipos, abs=1e-12)
    assert (found.memory.model, found.memory.data, found.memory.arena) == (model.nbuffer, data.nbuffer, model.narena)
    assert found.sizes == {name: getattr(model, name) for name in found.sizes}
    assert (found.extent, found.timestep) == (model.stat.extent, model.opt.timestep)
    assert found.name == ET.parse(scene.path or "").getroot().get("model", "MuJoCo Model")
    assert found.jacobian == ("sparse" if mujoco.mj_isSparse(model) else "dense")


def test_nothing_has_no_centre_of_mass_and_no_settings(described: Callable[[str], ModelDescription]) -> None:
    empty = described("<mujoco/>")
    assert (empty.summary.mass, empty.summary.centre_of_mass, empty.summary.file) == (0, None, None)
    assert [name for name in SECTIONS if getattr(empty, name)] == ["summary", "bodies", "statistics"]
    assert [(body.name, body.parent, body.depth) for body in empty.bodies] == [("world", -1, 0)]


def leaves(value: Any) -> Iterator[Any]:
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, dict | tuple):
        for item in value.values() if isinstance(value, dict) else value:
            yield from leaves(item)
    else:
        yield value


def test_every_value_is_plain(scene: ModelDescription, mixed: ModelDescription) -> None:
    for description in (scene, mixed):
        for name in SECTIONS:
            assert {type(leaf) for leaf in leaves(getattr(description, name))} <= {str, int, float, bool, type(None)}


def tiles(blocks: list[tuple[int | None, int]], total: int) -> bool:
    """Whether blocks of (start, size) lie one after the other, from 0 to `total`."""
    taken = [i for start, size in blocks if start is not None for i in range(start, start + size)]
    return taken == [*range(total)]


def test_addresses_tile_every_vector(scene: ModelDescription, mixed: ModelDescription) -> None:
    for found in (scene, mixed):
        model = found.model
        assert tiles([(joint.qpos, joint.qpos_size) for joint in found.joints], model.nq)
        assert tiles([(joint.dof, joint.dof_size) for joint in found.joints], model.nv)
        assert tiles([(actuator.ctrl, actuator.ctrl_size) for actuator in found.actuators], model.nu)
        assert tiles([(actuator.act, actuator.act_size) for actuator in found.actuators], model.na)
        assert tiles([(sensor.address, sensor.dim) for sensor in found.sensors], model.nsensordata)
