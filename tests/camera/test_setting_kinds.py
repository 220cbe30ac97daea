"""The declarations of rigs: from one come Python, the command line, documents, their schema and the way back."""

import dataclasses
from typing import Any, ClassVar

import mujoco
import pytest

from mjrun.camera.argument import parse_camera
from mjrun.camera.easing_and_shake import EasedNumber
from mjrun.camera.rigs.rig import BoundRig, ModelCameras, Rig
from mjrun.camera.script import RIGS
from mjrun.camera.setting_kinds import ObjectName, RampKind
from mjrun.options.kinds import Choice, ReadingContext
from mjrun.options.option import option, options, options_of, required
from mjrun.options.rendering import RIG_EXAMPLES
from mjrun.options.schema_validation import MisfitError

MODEL = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body name='box'><geom size='.1'/></body></worldbody></mujoco>"
)


@options
class CraneRig(Rig):
    """On the arm of a crane."""

    kind: ClassVar[str] = "crane"
    help: ClassVar[str] = "On a crane."

    base: str = required(converter=ObjectName(), kw_only=False, help="What it stands on.")
    height: EasedNumber = option(
        converter=RampKind("metres"), default=2, key="up", kw_only=False, help="Its height [m]."
    )
    arm: str = option(converter=Choice(("long", "short")), default="long", kw_only=False, help="Its arm.")

    def bind(self, cameras: ModelCameras, where: str) -> BoundRig:
        raise NotImplementedError


@pytest.mark.parametrize("rig", RIGS.values())
def test_every_field_of_every_rig_is_declared_with_a_sentence(rig: Any) -> None:
    declared = options_of(rig)
    assert [each.attribute for each in declared] == [field.name for field in dataclasses.fields(rig)]
    assert all(each.help.endswith(".") for each in declared)


def test_a_new_rig_has_its_form_from_its_declaration() -> None:
    form = CraneRig.form()
    value = {"base": "box", "up": {"from": 1, "to": 2}, "arm": "short"}
    rig = CraneRig("box", EasedNumber(1, 2), "short")
    assert form.read(value, ReadingContext()) == rig
    assert form.plain(rig) == value
    assert form.read({"base": "box", "up": 3}, ReadingContext()) == CraneRig("box", EasedNumber.still(3))
    definitions: dict[str, Any] = {}
    assert form.schema(ReadingContext(), definitions) == {"$ref": "#/$defs/Crane"}
    assert definitions["Crane"]["description"] == "On the arm of a crane."
    assert definitions["Crane"]["properties"]["up"]["description"] == "Its height [m]."
    assert definitions["Crane"]["properties"]["arm"]["enum"] == ["long", "short"]


@pytest.mark.parametrize("value", [{"up": 0}, {"up": {"from": 1, "to": -1}}, {"arm": "none"}, {"height": 1}])
def test_what_is_not_as_declared_is_refused(value: dict[str, object]) -> None:
    with pytest.raises(MisfitError):
        CraneRig.form().read({"base": "box", **value}, ReadingContext())


def test_a_new_rig_has_its_argument_from_its_declaration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RIGS, "crane", CraneRig)
    monkeypatch.setitem(RIG_EXAMPLES, "crane", "crane:box")
    shot = parse_camera("crane:box,up=1..3,roll=4", MODEL).shots[0]
    assert shot.rig == CraneRig("box", EasedNumber(1, 3))
    assert shot.roll == EasedNumber(4, 4)
