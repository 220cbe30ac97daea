"""Theorems about described flexes and plugins: they are what the source says."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco

from mjrun.model.description.model_description import ModelDescription


def test_plugins_are_reported_by_name_with_what_the_source_sets(shared_models: Path) -> None:
    path = shared_models / "plugin/actuator/pid.xml"
    written = {
        instance.get("name"): {config.get("key"): config.get("value") for config in instance.findall("config")}
        for instance in ET.parse(path).getroot().iter("instance")
    }
    found = ModelDescription(mujoco.MjModel.from_xml_path(str(path))).plugins
    assert {plugin.name: plugin.settings for plugin in found} == written
    assert {plugin.plugin for plugin in found} == {"mujoco.pid"}
    assert [plugin.users for plugin in found] == [(f"actuator/actuator:{i}",) for i in range(4)]


def test_a_flex_is_counted_and_its_equality_names_it(shared_models: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(shared_models / "flex/pancake.xml"))
    found = ModelDescription(model)
    (flex,) = found.flexes
    assert (flex.name, flex.elements_are, flex.edge_equality) == ("plate", "triangles", "edges")
    assert (flex.vertices, flex.elements, flex.edges) == (model.nflexvert, model.nflexelem, model.nflexedge)
    assert [(e.type, e.object_kind, e.object1) for e in found.equalities] == [("flex", "flex", "plate")]
