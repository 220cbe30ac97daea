"""A model with a key is written whole, from where it loads, or not at all."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.model import state
from mjrun.outputs.keyframe import KeyframeWriter

XML = b"""<mujoco>
  <compiler meshdir="meshes"/>
  <asset><mesh name="m" file="tetra.obj"/></asset>
  <include file="bodies.xml"/>
</mujoco>
"""
BODIES = '<mujoco><worldbody><body name="b"><freejoint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
TETRA = "v 0 0 0\nv {0} 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def make(folder: Path, edge: int = 1) -> Path:
    """A model of three files in a folder of its own."""
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes/tetra.obj").write_text(TETRA.format(edge))
    (folder / "bodies.xml").write_text(BODIES)
    (folder / "model.xml").write_bytes(XML)
    return folder / "model.xml"


def fallen(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qvel[:] = 1, 2, 3, 4, 5, 6
    mujoco.mj_step(model, data, nstep=77)
    return state.save(model, data)


@pytest.mark.parametrize("name", ["other.xml", "model.xml"])
def test_a_key_beside_the_model_or_in_it_starts_where_the_state_was(tmp_path: Path, name: str) -> None:
    source = make(tmp_path / "a")
    model = mujoco.MjModel.from_xml_path(str(source))
    last = fallen(model)
    with KeyframeWriter(f"{tmp_path}/a/{name}", source, XML, "rest", model) as writer:
        assert writer.write(model, last) == []
        assert source.read_bytes() == XML
        writer.publish()

    again = mujoco.MjModel.from_xml_path(f"{tmp_path}/a/{name}")
    data = mujoco.MjData(again)
    mujoco.mj_resetDataKeyframe(again, data, again.key("rest").id)
    found = state.save(again, data)
    for field, part in state.fields(state.sizes(model)).items():
        assert field == "qacc_warmstart" or np.array_equal(found[part], last[part]), field
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"meshes", "bodies.xml", "model.xml", name}


def test_where_its_files_would_not_be_found_nothing_is_written(tmp_path: Path) -> None:
    source = make(tmp_path / "a")
    model = mujoco.MjModel.from_xml_path(str(source))
    target = tmp_path / "b.xml"
    with pytest.raises(FileError, match=r"b.xml: would not load: .*'bodies.xml'|bodies") as caught:
        KeyframeWriter(str(target), source, XML, "rest", model)
    assert "relative paths in it start from the folder of the model" in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_where_other_files_of_these_names_are_nothing_is_written(tmp_path: Path) -> None:
    source, other = make(tmp_path / "a"), make(tmp_path / "b", edge=2)
    model = mujoco.MjModel.from_xml_path(str(source))
    with pytest.raises(FileError, match=r"would be another model than .*model.xml: files beside it differ"):
        KeyframeWriter(str(other), source, XML, "rest", model)
    assert other.read_bytes() == XML

    same = make(tmp_path / "c")
    with KeyframeWriter(str(same), source, XML, "rest", model):
        pass
    assert same.read_bytes() == XML


def test_a_model_that_has_been_changed_in_the_meantime_is_left_alone(tmp_path: Path) -> None:
    source = make(tmp_path / "a")
    model = mujoco.MjModel.from_xml_path(str(source))
    with KeyframeWriter(str(source), source, XML, "rest", model) as writer:
        source.write_bytes(XML + b"<!-- edited -->\n")
        with pytest.raises(FileError, match="has changed since it was read, and is left unchanged"):
            writer.write(model, fallen(model))
    assert source.read_bytes() == XML + b"<!-- edited -->\n"


def test_what_a_key_cannot_hold_is_reported(tmp_path: Path) -> None:
    xml = (
        b'<mujoco><size nuserdata="2"/><worldbody><body name="hand" mocap="true"/><body name="a"><joint/>'
        b'<geom size=".1"/></body></worldbody><equality><joint joint1="j"/></equality></mujoco>'
    ).replace(b"<joint/>", b'<joint name="j"/>')
    source = tmp_path / "m.xml"
    source.write_bytes(xml)
    model = mujoco.MjModel.from_xml_path(str(source))
    data = mujoco.MjData(model)
    data.userdata[:], data.xfrc_applied[2, 1], data.eq_active[0], data.mocap_quat[0] = 3, 1, 0, (1, 1, 0, 0)
    with KeyframeWriter(str(source), source, xml, "rest", model) as writer:
        told = writer.write(model, state.save(model, data))
    assert told == [
        "a keyframe does not hold xfrc_applied: its value at this instant is lost",
        "a keyframe does not hold eq_active: its value at this instant is lost",
        "MuJoCo normalizes quaternions of keyframes: mocap_quat differs in its last bits",
        "a keyframe does not hold userdata: its value at this instant is lost",
    ]
