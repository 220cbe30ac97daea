"""Derived columns, against MuJoCo's own functions and closed forms."""

import mujoco
import numpy as np
import pytest

from mjrun.probe.derived import DERIVED
from mjrun.probe.fields import MjDataProbe, Probe
from tests.cases import mjcf

MODEL = mujoco.MjModel.from_xml_string(mjcf("tumbling_pair"))


def at(seconds: float) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qvel[:] = np.linspace(-1, 2, MODEL.nv)
    mujoco.mj_step(MODEL, data, nstep=round(seconds / MODEL.opt.timestep))
    mujoco.mj_forward(MODEL, data)
    return data


def values_of(
    probe: Probe, model: mujoco.MjModel, data: mujoco.MjData, initial: mujoco.MjData | None = None
) -> np.ndarray:
    if isinstance(probe, MjDataProbe):
        return probe.measure(model, data)
    now, first = ({name: np.array(getattr(one, name)) for name in probe.fields} for one in (data, initial or data))
    return probe.compute(now, first)


def row(name: str, data: mujoco.MjData) -> dict[str, float]:
    probe: Probe = DERIVED[name](MODEL)
    values = values_of(probe, MODEL, data)
    return dict(zip([column.name.split("/", 1)[1] for column in probe.columns], values, strict=True))


@pytest.mark.parametrize("seconds", [0, 0.1, 0.5])
@pytest.mark.parametrize(("kind", "name"), [("BODY", "a"), ("BODY", "b"), ("GEOM", "rod"), ("SITE", "corner")])
def test_speeds_are_those_of_mujoco(seconds: float, kind: str, name: str) -> None:
    data, velocity = at(seconds), np.zeros(6)
    which = mujoco.mjtObj.__members__[f"mjOBJ_{'XBODY' if kind == 'BODY' else kind}"]
    index = mujoco.mj_name2id(MODEL, mujoco.mjtObj.__members__[f"mjOBJ_{kind}"], name)
    mujoco.mj_objectVelocity(MODEL, data, which, index, velocity, 0)
    assert row("speed", data)[name] == pytest.approx(np.linalg.norm(velocity[3:]), rel=1e-12)


@pytest.mark.parametrize("seconds", [0, 0.1, 0.5])
def test_momentum_and_centre_of_mass_are_those_of_mujoco(seconds: float) -> None:
    data = at(seconds)
    mujoco.mj_subtreeVel(MODEL, data)
    found = row("momentum", data)
    linear = data.subtree_linvel[0] * MODEL.body_subtreemass[0]
    assert [found[f"p{axis}"] for axis in "xyz"] == pytest.approx(list(linear), rel=1e-9, abs=1e-12)
    assert [found[f"l{axis}"] for axis in "xyz"] == pytest.approx(list(data.subtree_angmom[0]), rel=1e-9, abs=1e-12)
    assert list(row("com", data).values()) == list(data.subtree_com[0])


def test_energy_is_mujoco_s_and_drifts_from_the_first_row() -> None:
    early, late = at(0), at(0.2)
    probe = DERIVED["energy"](MODEL)
    rows = [values_of(probe, MODEL, data, early) for data in (late, early, late)]  # whatever was measured before
    assert rows.pop(0).tolist() == rows[1].tolist()
    assert list(rows[1][:2]) == list(late.energy)
    assert rows[1][2] == late.energy.sum()
    assert rows[0][3] == 0
    assert rows[1][3] == late.energy.sum() - early.energy.sum()


def test_contact_forces_at_rest_carry_the_weight() -> None:
    data = mujoco.MjData(MODEL)
    mujoco.mj_step(MODEL, data, nstep=4000)
    mujoco.mj_forward(MODEL, data)
    found = row("contact_force", data)
    weight = MODEL.body_mass.sum() * 9.81
    assert found["normal/z"] == pytest.approx(weight, rel=1e-3)
    assert abs(found["normal/x"]) < 1e-9
    assert row("contact", data)["ncon"] == data.ncon > 0
    assert row("penetration", data)["deepest"] == -data.contact.dist.min() > 0


def test_contact_forces_are_what_mujoco_applies_to_the_body() -> None:
    data = at(0.5)
    found = row("contact_force", data)
    total = sum(np.array([found[f"{part}/{axis}"] for axis in "xyz"]) for part in ("normal", "friction"))
    dofs = [MODEL.joint(j).dofadr[0] for j in range(MODEL.njnt) if MODEL.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    applied = sum(data.qfrc_constraint[dof : dof + 3] for dof in dofs)
    assert np.linalg.norm(total) > 1
    assert total == pytest.approx(applied, rel=1e-9, abs=1e-9)


def test_nothing_touches_in_the_air() -> None:
    data = mujoco.MjData(MODEL)
    data.qpos[2] = data.qpos[10] = 5
    mujoco.mj_forward(MODEL, data)
    assert row("contact", data) == {"ncon": 0}
    assert row("penetration", data) == {"deepest": 0}
    assert set(row("contact_force", data).values()) == {0}
    assert row("solver", data) == {"niter": 0, "nefc": 0}


def test_every_column_has_a_unit_and_a_meaning() -> None:
    pure = {"contact/ncon", "solver/niter", "solver/nefc"}
    for make in DERIVED.values():
        for column in make(MODEL).columns:
            assert column.meaning
            assert column.unit or column.name in pure or column.name.startswith("warning/")


def test_warnings_are_counted_up_to_the_instant() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint/><geom size=".1"/></body></worldbody>'
        '<actuator><motor joint="joint0"/></actuator></mujoco>'.replace("<joint/>", '<joint name="joint0"/>')
    )
    data, probe = mujoco.MjData(model), DERIVED["warning"](model)
    assert isinstance(probe, MjDataProbe)
    named = dict(zip([column.name for column in probe.columns], range(99), strict=False))
    data.ctrl[0] = 1e11  # MuJoCo takes it for bad, and warns
    for count in (1, 2, 3):
        mujoco.mj_forward(model, data)
        found = probe.measure(model, data)
        assert found[named["warning/badctrl"]] == count
        assert found.sum() == count
