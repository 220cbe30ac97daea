"""The declarations of rigs: from one come Python, the command line, documents, their schema and the way back."""

import dataclasses
from dataclasses import dataclass
from typing import Annotated, ClassVar

import mujoco
import pytest

from mjrun.camera.argument import parse_camera
from mjrun.camera.easing import Ramp
from mjrun.camera.rigs.registry import RIGS
from mjrun.camera.rigs.rig import BoundRig, ModelCameras, Rig
from mjrun.camera.rigs.settings import Setting, declared_fields

MODEL = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body name='box'><geom size='.1'/></body></worldbody></mujoco>"
)


@dataclass(frozen=True)
class CraneRig(Rig):
    """On the arm of a crane."""

    kind: ClassVar[str] = "crane"
    help: ClassVar[str] = "On a crane."
    argument: ClassVar[str] = "crane:OBJECT"

    base: Annotated[str, Setting("object", "What it stands on.")]
    height: Annotated[Ramp, Setting("ramp", "Its height [m].", positive=True, unit="metres", key="up")] = Ramp(2, 2)  # noqa: RUF009
    note: str = "is not declared"

    def bind(self, cameras: ModelCameras, where: str) -> BoundRig:
        raise NotImplementedError


def test_fields_are_declared_in_order_with_key_and_default() -> None:
    base, height = declared_fields(CraneRig)
    assert (base.name, base.key, base.required) == ("base", "base", True)
    assert (height.name, height.key, height.default) == ("height", "up", Ramp(2, 2))


@pytest.mark.parametrize("rig", RIGS.values())
def test_every_field_of_every_rig_is_declared_with_a_sentence(rig: type) -> None:
    fields = declared_fields(rig)
    assert [field.name for field in fields] == [field.name for field in dataclasses.fields(rig)]
    assert all(field.setting.help.endswith(".") for field in fields)


def test_a_new_rig_has_its_argument_from_its_declaration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RIGS, "crane", CraneRig)
    shot = parse_camera("crane:box,up=1..3,roll=4", MODEL).shots[0]
    assert shot.rig == CraneRig("box", Ramp(1, 3))
    assert shot.roll == Ramp(4, 4)
