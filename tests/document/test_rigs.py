"""Forms of rigs, derived from their declarations."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import pytest
from pydantic import ValidationError

from mjrun.camera.easing import Ramp
from mjrun.camera.rigs.rig import BoundRig, ModelCameras, Rig
from mjrun.camera.rigs.settings import Setting
from mjrun.document.rigs import declared_model


@dataclass(frozen=True)
class CraneRig(Rig):
    """On the arm of a crane."""

    kind: ClassVar[str] = "crane"
    help: ClassVar[str] = "On a crane."

    height: Annotated[Ramp | None, Setting("ramp", "Its height [m].", positive=True, key="up")] = None
    arm: Annotated[str, Setting("choice", "Its arm.", choices=("long", "short"))] = "long"

    def bind(self, cameras: ModelCameras, where: str) -> BoundRig:
        raise NotImplementedError


def test_a_new_rig_has_its_form_from_its_declaration() -> None:
    form = declared_model(CraneRig)
    assert form.model_validate({"up": {"from": 1, "to": 2}, "arm": "short"}).value() == CraneRig(Ramp(1, 2), "short")
    assert form.model_validate({}).value() == CraneRig()
    schema = form.model_json_schema()
    assert schema["description"] == "On the arm of a crane."
    assert schema["properties"]["up"]["description"] == "Its height [m]."
    assert schema["properties"]["arm"]["enum"] == ["long", "short"]


@pytest.mark.parametrize("value", [{"up": 0}, {"up": {"from": 1, "to": -1}}, {"arm": "none"}, {"height": 1}])
def test_what_is_not_as_declared_is_refused(value: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        declared_model(CraneRig).model_validate(value)
