"""Tables of tendons, equalities, contact pairs and excludes."""

from collections.abc import Sequence

import mujoco
import pytest

from mjrun.cli.info_constraints import equalities, excludes, flexes, pairs, tendons
from mjrun.cli.table_cells import Column
from mjrun.model.description.model_description import ModelDescription

MODEL = """
<mujoco>
  <worldbody>
    <body name="a"><joint name="x" axis="1 0 0"/><geom name="p" size=".1"/><site name="s"/></body>
    <body name="b" pos="0 0 1"><joint name="y" axis="1 0 0"/><geom name="q" size=".1"/><site name="t"/></body>
  </worldbody>
  <tendon>
    <fixed name="sum" range="0 1" limited="true"><joint joint="x" coef="1"/><joint joint="y" coef="-.5"/></fixed>
    <spatial name="rope"><site site="s"/><site site="t"/></spatial>
  </tendon>
  <equality><joint name="gear" joint1="x" joint2="y" active="false"/></equality>
  <contact><pair name="touch" geom1="p" geom2="q" margin=".2"/><exclude name="none" body1="a" body2="b"/></contact>
</mujoco>
"""


def cells(columns: Sequence[Column]) -> dict[str, list[str]]:
    return {column.heading: list(column.cells) for column in columns}


@pytest.fixture(scope="module")
def model() -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(MODEL))


def test_a_tendon_has_its_path_with_coefficients_and_its_length(model: ModelDescription) -> None:
    columns = tendons(model.tendons)
    table = cells(columns)
    assert table["path"] == ["1 x, -0.5 y", "s, t"]
    assert (table["range"], table["length"]) == (["0..1", ""], ["0", "1"])
    assert next(column.unit for column in columns if column.heading == "length") == "rad\nm"


def test_constraints_name_what_they_join(model: ModelDescription) -> None:
    equality = cells(equalities(model.equalities))
    assert (equality["of"], equality["and"], equality[""]) == (["joint/x"], ["joint/y"], ["off"])
    pair = cells(pairs(model.pairs))
    assert (pair["geom 1"], pair["geom 2"], pair["margin"]) == (["p"], ["q"], ["0.2"])
    exclude = cells(excludes(model.excludes))
    assert {(exclude["body 1"][0], exclude["body 2"][0])} <= {("a", "b"), ("b", "a")}
    assert cells(flexes(model.flexes))["name"] == []
