"""The table of contacts, against MuJoCo's own functions, Newton's laws and forces mapped by hand."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.probe.contacts import RecordedContacts, contact_columns, contact_copiers, contact_rows, pair
from mjrun.probe.derived import contact_force
from mjrun.probe.row_expression import parse_condition
from mjrun.probe.vocabularies import ModelVocabulary
from tests.cases import mjcf

# The ball on the box rolls, slides and spins; the bead lies off its body's origin.
PILE = """
<mujoco>
  <option cone="{cone}"/>
  <default><geom condim="{condim}" friction=".7 .01 .005"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="a" pos="0 0 .098" euler="0 0 30"><freejoint/><geom name="box" type="box" size=".2 .2 .1"/></body>
    <body name="b" pos=".05 0 .297"><freejoint/><geom name="ball" size=".1"/></body>
    <body name="c" pos="1 0 .2" euler="40 0 0"><freejoint/><geom size=".05" pos="0 0 -.15"/></body>
  </worldbody>
</mujoco>
"""
KINDS = [(cone, condim) for cone in ("pyramidal", "elliptic") for condim in (1, 3, 4, 6)]
SHEET = mjcf("sheets")


def contacts(model: mujoco.MjModel, data: mujoco.MjData, time: float) -> np.ndarray:
    """The rows of one instant."""
    return contact_rows(RecordedContacts.of(model, data), np.array([time]))


class Read:
    """Rows by the names of their columns: `read["force"]` is `(n, 3)`, `read.texts("geom1")` the labels."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, time: float = 0) -> None:
        self.columns = contact_columns(model)
        self.rows = contacts(model, data, time)
        assert self.rows.shape == (data.ncon, len(self.columns))
        assert self.rows.dtype == np.float64

    def __getitem__(self, group: str) -> np.ndarray:
        alone = [i for i, column in enumerate(self.columns) if column.name == group]
        if alone:
            return self.rows[:, alone[0]]
        return self.rows[:, [i for i, column in enumerate(self.columns) if column.name.startswith(f"{group}/")]]

    def texts(self, name: str) -> list[str | None]:
        (labels,) = (column.labels for column in self.columns if column.name == name)
        return [labels[int(i)] if i >= 0 else None for i in self[name]]


def forwarded(source: str, steps: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(source)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=steps)
    mujoco.mj_forward(model, data)
    return model, data


def pile(cone: str, condim: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The pile in wild motion, all of it in contact."""
    model = mujoco.MjModel.from_xml_string(PILE.format(cone=cone, condim=condim))
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(condim).uniform(-1, 1, model.nv)
    data.qvel[[2, 8, 14]] = -0.1
    data.qpos[16] = 0.048 + 0.15 * np.cos(np.radians(40))  # the bead's z
    mujoco.mj_forward(model, data)
    return model, data


def test_the_columns_are_those_of_the_design() -> None:
    model, _ = forwarded(PILE.format(cone="elliptic", condim=3))
    found = contact_columns(model)
    vectors = [f"{group}/{axis}" for group in ("pos", "normal") for axis in "xyz"]
    vectors += [f"{group}/{part}" for group in ("force", "torque") for part in ("normal", "tangent1", "tangent2")]
    vectors += [f"{group}/{axis}" for group in ("world_force", "world_torque") for axis in "xyz"]
    named = ["time", "contact", "geom1", "geom2", "body1", "body2", "dist", *vectors]
    assert [column.name for column in found] == named
    assert all(column.meaning for column in found)
    units = {"time": "s", "dist": "m", "pos": "m"} | dict.fromkeys(["force", "world_force"], "N")
    units |= dict.fromkeys(["torque", "world_torque"], "N·m")
    assert [column.unit for column in found] == [units.get(name.split("/")[0], "") for name in named]
    assert [column.name for column in found if column.labels] == ["geom1", "geom2", "body1", "body2"]


def test_a_box_at_rest_is_carried_with_its_weight_by_the_floor_below() -> None:
    model, data = forwarded(
        """
        <mujoco><worldbody>
          <body name="crate" pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".2 .1 .1"/></body>
          <geom name="floor" type="plane" size="5 5 1"/>
        </worldbody></mujoco>
        """,
        steps=3000,
    )
    read = Read(model, data, time=6.0)
    assert list(read["time"]) == [6] * 4
    assert list(read["contact"]) == [0, 1, 2, 3]
    assert read.texts("geom1") == ["floor"] * 4
    assert read.texts("geom2") == ["box"] * 4
    assert read.texts("body1") == ["world"] * 4
    assert read.texts("body2") == ["crate"] * 4
    assert read["normal"] == pytest.approx(np.tile([0, 0, 1], (4, 1)))
    weight = model.body_mass.sum() * 9.81
    assert read["force"][:, 0].sum() == pytest.approx(weight, rel=1e-6)
    assert read["world_force"].sum(axis=0) == pytest.approx([0, 0, weight], rel=1e-6, abs=1e-6)
    corners = {(x, y) for x in (-0.2, 0.2) for y in (-0.1, 0.1)}
    assert {(round(x, 3), round(y, 3)) for x, y, _ in read["pos"]} == corners
    assert read["pos"][:, 2] == pytest.approx(read["dist"] / 2)
    assert (read["dist"] < 0).all()


@pytest.mark.parametrize(("cone", "condim"), KINDS)
def test_forces_are_those_of_mujoco_and_turn_into_the_world_by_the_contact_s_frame(cone: str, condim: int) -> None:
    model, data = pile(cone, condim)
    read = Read(model, data)
    wrench = np.zeros(6)
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, wrench)
        frame = data.contact[i].frame.reshape(3, 3)
        assert list(read["force"][i]) == list(wrench[:3])
        assert list(read["torque"][i]) == list(wrench[3:])
        assert list(read["normal"][i]) == list(frame[0])
        assert read["world_force"][i] == pytest.approx(frame.T @ wrench[:3], rel=1e-12, abs=1e-12)
        assert read["world_torque"][i] == pytest.approx(frame.T @ wrench[3:], rel=1e-12, abs=1e-12)
    assert read["force"][:, 0].max() > 1
    assert (np.abs(read["force"][:, 1:]).max() > 0.1) == (condim > 1)
    assert (np.abs(read["torque"][:, 0]).max() > 1e-3) == (condim > 3)
    assert (np.abs(read["torque"][:, 1:]).max() > 1e-3) == (condim > 4)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_the_pull_of_adhesive_geoms_is_part_of_the_force(cone: str) -> None:
    sticky = PILE.format(cone=cone, condim=3).replace("<geom ", '<geom adhesion="3" gap=".02" ', 1)
    model, data = forwarded(sticky, 20)
    assert min(contact.adhesion for contact in data.contact) > 0
    read, wrench = Read(model, data), np.zeros(6)
    for i, force in enumerate(read["force"]):
        mujoco.mj_contactForce(model, data, i, wrench)
        assert list(force) == list(wrench[:3])

    for body in "abc":
        force = sum(
            (sign * read["world_force"][[text == body for text in read.texts(side)]].sum(axis=0))
            for sign, side in ((-1, "body1"), (1, "body2"))
        )
        start = model.body(body).dofadr[0]
        applied = (data.qfrc_constraint + data.qfrc_passive)[start : start + 3]  # MuJoCo's passive forces hold the pull
        assert force == pytest.approx(applied, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("cone", "condim"), KINDS)
def test_wrenches_mapped_by_hand_are_the_generalized_forces_of_every_body(cone: str, condim: int) -> None:
    model, data = pile(cone, condim)
    read = Read(model, data)
    assert "a" in read.texts("body1") or "b" in read.texts("body1")  # so that what geom1 feels is tried
    for body in "abc":
        force, torque, at = np.zeros(3), np.zeros(3), data.body(body).xpos
        for sign, side in ((-1, "body1"), (1, "body2")):
            mine = np.array([text == body for text in read.texts(side)])
            pushed, turned = sign * read["world_force"][mine], sign * read["world_torque"][mine]
            force += pushed.sum(axis=0)
            torque += (np.cross(read["pos"][mine] - at, pushed) + turned).sum(axis=0)
        applied = data.qfrc_constraint[model.body(body).dofadr[0] :]
        assert force == pytest.approx(applied[:3], rel=1e-9, abs=1e-9)
        turned_back = data.body(body).xmat.reshape(3, 3).T @ torque  # a free joint turns in its own axes
        assert turned_back == pytest.approx(applied[3:6], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_contacts_of_many_instants_are_those_of_each_to_the_last_bit(cone: str, condim: int) -> None:
    model, data = pile(cone, condim)
    model.geom_condim[: model.ngeom // 2] = 1  # several dimensions at the same instant
    mujoco.mj_resetData(model, data)
    structures, efc_forces, rows, forces, counts = [], [], [], [], []
    copiers = contact_copiers(data)
    assert [copy() for copy in copiers] == [b"", b""]
    for step in range(60):
        mujoco.mj_forward(model, data)
        structures.append(copiers.structures())
        efc_forces.append(copiers.forces())
        rows.append(contacts(model, data, float(step)))
        counts.append(data.ncon)
        for index in range(data.ncon):
            force = np.zeros(6)
            mujoco.mj_contactForce(model, data, index, force)
            forces.append(force)
        mujoco.mj_step(model, data)
    together = RecordedContacts(model, structures, efc_forces)
    assert len({*counts}) > 1
    assert together.counts.tolist() == counts
    assert together.wrenches.tobytes() == np.array(forces).tobytes()
    assert contact_rows(together, np.arange(60.0)).tobytes() == np.concatenate(rows).tobytes()


def test_the_layout_of_a_contact_is_that_of_mujoco() -> None:
    _, data = pile("elliptic", 6)
    fields = RecordedContacts.of(_, data).fields
    assert data.ncon > 1
    for name in ("dist", "pos", "frame", "friction", "solimp", "dim", "geom", "flex", "vert", "exclude", "efc_address"):
        assert np.array_equal(fields[name], getattr(data.contact, name))


def test_the_sums_are_those_of_the_probe_of_all_contacts() -> None:
    model, data = pile("elliptic", 3)
    read, probe = Read(model, data), contact_force(model)
    normal, friction = probe.measure(model, data).reshape(2, 3)
    assert read["world_force"].sum(axis=0) == pytest.approx(normal + friction)
    assert read["force"][:, :1].T @ read["normal"] == pytest.approx(normal[None])


def test_a_contact_in_the_gap_is_there_without_a_force() -> None:
    model, data = forwarded(
        """
        <mujoco><worldbody>
          <geom name="floor" type="plane" size="5 5 1" gap=".02"/>
          <body pos="0 0 .11"><freejoint/><geom size=".1"/></body>
          <body pos="1 0 .09"><freejoint/><geom size=".1"/></body>
        </worldbody></mujoco>
        """
    )
    read = Read(model, data)
    assert sorted(data.contact.efc_address < 0) == [False, True]
    assert dict(zip(read["dist"].round(6), read["force"][:, 0] > 0, strict=True)) == {0.01: False, -0.01: True}
    assert not read["world_force"][read["dist"] > 0].any()
    assert not read["torque"][read["dist"] > 0].any()


def test_without_contacts_there_are_no_rows_and_the_same_columns() -> None:
    model, data = pile("elliptic", 3)
    data.qpos[[2, 9, 16]] += [1, 2, 1]
    mujoco.mj_forward(model, data)
    assert contacts(model, data, 0.0).shape == (0, 25)
    nothing, its_data = forwarded("<mujoco/>")
    assert contacts(nothing, its_data, 0.0).shape == (0, 25)
    assert [bool(c.labels) for c in contact_columns(nothing)] == [bool(c.labels) for c in contact_columns(model)]


def test_a_flex_touches_with_the_bodies_that_its_vertices_are() -> None:
    model, data = forwarded(SHEET)
    read = Read(model, data)
    assert data.ncon == 9
    assert read.texts("geom1") == ["floor"] * 9
    assert read.texts("body1") == ["world"] * 9
    assert read.texts("geom2") == ["flex/low"] * 9
    for body, point in zip(read.texts("body2"), read["pos"], strict=True):
        assert str(body).startswith("low_")
        assert data.body(str(body)).xpos[:2] == pytest.approx(point[:2], abs=1e-9)
    sliders = [model.body(str(body)).dofadr[0] for body in read.texts("body2")]
    contact = np.zeros(model.nv)
    for dof, force in zip(sliders, read["world_force"], strict=True):
        contact[dof : dof + 3] += force
    others = data.qfrc_constraint - contact  # edges, which pull both their ends alike
    assert others.reshape(-1, 3).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


def test_a_flex_without_a_name_is_called_by_its_index_and_may_be_one_body() -> None:
    model, data = forwarded(
        """
        <mujoco><worldbody>
          <body name="plate" pos="0 0 .009"><freejoint/><geom size=".01" pos=".3 .3 1"/></body>
          <geom type="plane" size="1 1 1"/>
        </worldbody>
        <deformable>
          <flex dim="2" radius=".01" body="plate" vertex="0 0 0 .1 0 0 0 .1 0" element="0 1 2"/>
        </deformable></mujoco>
        """
    )
    read = Read(model, data)
    assert read.texts("geom1") == ["geom:0"] * 3
    assert read.texts("geom2") == ["flex:0"] * 3
    assert read.texts("body2") == ["plate"] * 3


def test_a_flex_that_touches_with_its_elements_has_no_body(shared_models: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(shared_models / "flex/pancake.xml"))
    data = mujoco.MjData(model)
    while not data.ncon:
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
    read = Read(model, data)
    touching = {text for side in ("geom1", "geom2") for text in read.texts(side)}
    assert "flex/plate" in touching
    for side in (0, 1):
        flexible, vertex = data.contact.flex[:, side] >= 0, data.contact.vert[:, side] >= 0
        assert [text == "flex/plate" for text in read.texts(f"geom{side + 1}")] == flexible.tolist()
        bodiless = [text is None for text in read.texts(f"body{side + 1}")]
        assert bodiless == (flexible & ~vertex).tolist()


# --- the number of contacts between two objects ----------------------------------------------------

# A cart with a loaded tray, on a floor, next to a wall; bodies and geoms share names.
CART = mjcf("wheeled_cart")
TOUCHING = ["world", "floor", "wall", "cart", "chassis", "left", "right", "tyre", "hub", "tray", "egg", "shell"]
TOUCHING += ["geom:left", "body:left", "geom:5", "body:5"]


def belongs(model: mujoco.MjModel, geom: int, name: str) -> bool:
    """Whether `geom` is what is called so, or hangs from it; by going up."""
    kind, colon, plain = name.partition(":")
    plain = plain if colon else name
    own = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
    bodies = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, i) for i in range(model.nbody)}
    if kind == "geom" or (not colon and name not in bodies):
        return plain in (own, str(geom))
    body, above = model.geom_bodyid[geom], []
    while not above or body:
        above += [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body), str(body)]
        body = model.body_parentid[body]
    return plain in above or plain == "world"


def count(text: str, model: mujoco.MjModel, data: mujoco.MjData) -> float:
    probe = pair(text, model)
    assert [column.name for column in probe.columns] == [f"contact/{text}"]
    (found,) = probe.measure(model, data)
    return float(found)


@pytest.mark.parametrize("steps", [0, 40, 300])
def test_contacts_between_two_objects_are_those_that_a_loop_counts_in_either_order(steps: int) -> None:
    model, data = forwarded(CART, steps)
    data.qpos[0] = 0.45  # to the wall
    mujoco.mj_forward(model, data)
    for a in TOUCHING:
        for b in TOUCHING:
            expected = 0
            for contact in data.contact:
                one, other = (int(geom) for geom in contact.geom)
                there = belongs(model, one, a) and belongs(model, other, b)
                expected += there or (belongs(model, one, b) and belongs(model, other, a))
            assert count(f"{a}/{b}", model, data) == count(f"{b}/{a}", model, data) == expected, (a, b)
    assert count("world/world", model, data) == data.ncon > 4
    assert count("cart/wall", model, data) > 0
    assert count("right/floor", model, data) == 2  # tyre and hub
    assert count("tyre/floor", model, data) == 1


def test_a_contact_of_an_object_with_itself_counts_once() -> None:
    model, data = forwarded(CART)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    data.qpos[9] = -0.2  # the tray into the chassis
    mujoco.mj_forward(model, data)
    inside = [c for c in data.contact if (model.body_rootid[model.geom_bodyid[c.geom]] == model.body("cart").id).all()]
    assert count("cart/cart", model, data) == count("cart/chassis", model, data) == len(inside) > 2
    assert count("chassis/chassis", model, data) == 0


def test_a_contact_in_the_gap_counts_as_it_does_for_mujoco() -> None:
    source = """
    <mujoco><worldbody>
      <geom name="floor" type="plane" size="5 5 1" gap=".02"/>
      <body name="ball" pos="0 0 .11"><freejoint/><geom size=".1"/></body>
    </worldbody></mujoco>
    """
    model, data = forwarded(source)
    assert data.ncon == 1
    assert count("ball/floor", model, data) == 1


def test_the_bare_name_of_a_flex_is_answered_with_its_full_name() -> None:
    model, _ = forwarded(SHEET)
    with pytest.raises(
        UnknownNameError, match=r"^no object 'low' \(did you mean 'flex:low'\?\)\nbodies, geoms and flexes: "
    ):
        pair("low/floor", model)
    for text in ("contact(low, floor)", "'contact/low/floor' > 0"):
        with pytest.raises(UnknownNameError, match=r"character \d+ \(did you mean 'flex:low'\?\)"):
            parse_condition(text, ModelVocabulary(model), "when")


def test_a_flex_counts_for_the_bodies_that_carry_all_of_it_and_a_vertex_for_its_own() -> None:
    model, data = forwarded(SHEET)
    assert count("flex:low/floor", model, data) == count("world/floor", model, data) == 9
    assert count("flex:up/floor", model, data) == 0
    assert [count(f"low_{i}/floor", model, data) for i in range(9)] == [1] * 9
    on_a_tray = SHEET.replace("<flexcomp", '<body name="tray"><freejoint/><flexcomp', 1)
    on_a_tray = on_a_tray.replace("</flexcomp>", "</flexcomp></body>", 1).replace('pos="0 0 1"', 'pos="0 0 .009"')
    on_a_tray = on_a_tray.replace("<edge", '<pin id="4"/><edge', 1)
    on_a_tray = on_a_tray.replace("<freejoint/>", '<freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')
    model, data = forwarded(on_a_tray)
    assert count("flex:up/floor", model, data) == count("tray/floor", model, data) == 9
    assert count("world/floor", model, data) == 18


def test_elements_of_a_flex_count_for_the_body_that_carries_all_of_it() -> None:
    source = """
    <mujoco><worldbody>
      <body name="net"><flexcomp name="net" type="grid" count="3 3 1" spacing=".1 .1 .1" mass="1" radius=".01" dim="2">
        <pin id="0"/><edge equality="true"/></flexcomp></body>
      <body name="ball" pos=".03 .02 .05"><freejoint/><geom size=".05"/></body>
    </worldbody></mujoco>
    """
    model, data = forwarded(source)
    assert data.ncon == count("net/ball", model, data) == count("flex:net/ball", model, data) > 0
    assert (data.contact.elem.max(axis=1) >= 0).all()
    assert count("net_1/ball", model, data) == 0


def test_without_contacts_and_in_an_empty_model_the_number_is_zero() -> None:
    model, data = forwarded(CART.replace('pos="0 0 .195"', 'pos="0 0 3"'))
    assert count("cart/floor", model, data) == 0
    model, data = forwarded("<mujoco/>")
    assert count("world/world", model, data) == 0


SLASHES = """
<mujoco><worldbody>
  <body name="r/hand"><geom name="r/tip" size=".1"/></body>
  <body name="a"><geom name="a/b" size=".1"/></body><body name="b/c"><freejoint/><geom name="c" size=".1"/></body>
</worldbody></mujoco>
"""


def test_names_with_slashes_are_reported_apart_by_what_there_is() -> None:
    model, data = forwarded(SLASHES)
    mujoco.mj_forward(model, data)
    assert count("r/hand/r/tip", model, data) == 0
    assert count("body:a/body:b/c", model, data) == 1
    assert pair("r/hand/r/tip", model).columns[0].meaning == "number of contacts between 'r/hand' and 'r/tip'"
    with pytest.raises(UsageError) as caught:
        pair("a/b/c", model)
    assert str(caught.value) == (
        "contact/a/b/c may be 'a' and 'b/c' or 'a/b' and 'c'\n"
        "`body:NAME` and `geom:NAME` show where the name of an object begins"
    )
    with pytest.raises(UnknownNameError, match=r"^no object 'r/tap' \(did you mean 'r/tip'"):
        pair("r/hand/r/tap", model)
