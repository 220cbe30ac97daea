"""Theorems about MuJoCo's known faults: named where they apply, cured by the cure, silent elsewhere."""

import mujoco
import pytest

from mjrun.model.override import Override, apply
from mjrun.model.source import SPARSE_NEWTON, bugs_of_model, bugs_of_version

MODEL = """<mujoco><option solver="{solver}" jacobian="{jacobian}"/><worldbody><body><joint/><geom size="1"/></body>
</worldbody></mujoco>"""


def model(solver: str = "Newton", jacobian: str = "sparse") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.format(solver=solver, jacobian=jacobian))


@pytest.mark.parametrize(("version", "number"), [("4.0.0", 1), ("4.0.1", 0), ("4.1.0", 0), ("3.9.9", 0)])
def test_only_mujoco_4_0_0_has_a_known_fault(version: str, number: int) -> None:
    assert len(bugs_of_version(version)) == number


@pytest.mark.parametrize(
    ("solver", "jacobian", "touched"),
    [
        ("Newton", "sparse", True),
        ("Newton", "dense", False),
        ("Newton", "auto", False),  # one degree of freedom: auto is dense
        ("CG", "sparse", False),
        ("PGS", "sparse", False),
    ],
)
def test_the_fault_touches_sparse_newton_only(
    monkeypatch: pytest.MonkeyPatch, solver: str, jacobian: str, touched: bool
) -> None:
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "4.0.0")
    assert bugs_of_model(model(solver, jacobian)) == ([SPARSE_NEWTON] if touched else [])


def test_another_mujoco_has_no_fault_in_any_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "4.0.1")
    assert bugs_of_model(model()) == []


def test_the_cure_that_the_message_gives_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "4.0.0")
    path, value = SPARSE_NEWTON.split(" set ")[1].split("=")
    spec = mujoco.MjSpec.from_string(MODEL.format(solver="Newton", jacobian="sparse"))
    apply(spec, Override(path, value))
    assert bugs_of_model(spec.compile()) == []
