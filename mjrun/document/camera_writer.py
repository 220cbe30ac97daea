"""From camera scripts back to camera documents, as plain values."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import cast

from mjrun.camera import script
from mjrun.camera.easing import Blend, Ramp
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import Waypoint
from mjrun.camera.rigs.rig import Rig
from mjrun.camera.rigs.settings import declared_fields
from mjrun.camera.shake import Shake
from mjrun.document.tree import Mapped, Plain
from mjrun.document.yaml_writer import decimal, number
from mjrun.errors import UsageError


def camera_document(camera: script.CameraScript) -> Mapped:
    """The document of `camera`, as it is written within a run document.

    Raises:
      UsageError: a camera document cannot hold this.
    """
    name = {} if camera.name == "script" else {"name": camera.name}
    return {**name, "shots": [_shot(shot, f"{camera.name}: shots[{i}]") for i, shot in enumerate(camera.shots)]}


def event_document(event: script.Event, what: str) -> Mapped:
    """An event, as in `{when: speed(box) > 0.02, nth: 2}`."""
    otherwise: str | float | None = None
    if event.otherwise is not None:
        otherwise = "end" if event.otherwise == "end" else decimal(Fraction(event.otherwise), what)
    offset = None if not event.offset else decimal(event.offset, what)
    nth = None if event.nth == 1 else event.nth
    return without_none({"when": event.when, "nth": nth, "offset": offset, "else": otherwise})


def without_none(values: Mapping[str, Plain]) -> Mapped:
    """Those of `values` that are not None."""
    return {key: value for key, value in values.items() if value is not None}


def _shot(shot: script.Shot, what: str) -> Mapped:
    until = event_document(shot.until, what) if isinstance(shot.until, script.Event) else _time(shot.until, what)
    return without_none(
        {
            **_rig(shot.rig, what),
            "until": until,
            "duration": _time(shot.lasting, what),
            "speed": _time(shot.speed, what),
            "blend": shot.blend and _changed(shot.blend, Blend()),
            "roll": None if shot.roll == Ramp.still(0) else _ramp(shot.roll),
            "fovy": _ramp(shot.fovy),
            "shake": shot.shake and _changed(shot.shake, Shake()),
            "fit": shot.fit and _fit(shot.fit),
        }
    )


def _rig(rig: Rig, what: str) -> Mapped:
    if isinstance(rig, ModelRig):
        return {rig.kind: rig.camera}
    fields = _declared(rig)
    for _, conflict in rig.conflicts(fields):
        raise UsageError(f"{what}: a camera document cannot hold this: {conflict}")
    return {rig.kind: fields}


def _declared(value: Rig | Waypoint) -> Mapped:
    """The declared fields of a rig or a waypoint, but for those that have their defaults."""
    values = vars(value)
    fields = [field for field in declared_fields(type(value)) if values[field.name] != field.default]
    fields.sort(key=lambda field: field.setting.kind == "records")  # long lists last
    return {field.key: _field(values[field.name]) for field in fields}


def _field(value: object) -> Plain:
    match value:
        case bool() | str():
            return value
        case int() | float():
            return number(value)
        case Ramp():
            return _ramp(value)
        case Waypoint():
            return _declared(value)
        case _:
            assert isinstance(value, Sequence)
            return [_field(item) for item in cast("Sequence[object]", value)]


def _ramp(ramp: Ramp | None) -> Plain:
    if ramp is None or ramp == Ramp.still(ramp.start):
        return None if ramp is None else number(ramp.start)
    ease = {} if ramp.ease == "linear" else {"ease": ramp.ease}
    return {"from": number(ramp.start), "to": number(ramp.end), **ease}


def _time(value: Fraction | None, what: str) -> float | None:
    return None if value is None else decimal(value, what)


def _changed(value: Blend | Shake, default: Blend | Shake) -> Mapped:
    """The fields of `value` that are not as in `default`."""
    defaults = vars(default)
    return {key: _field(field) for key, field in vars(value).items() if field != defaults[key]}


def _fit(fit: script.Fit) -> Plain:
    return fit.target if fit == script.Fit(fit.target) else {"target": fit.target, "margin": number(fit.margin)}
