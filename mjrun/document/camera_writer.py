"""From scripts back to what a camera document says of them, as plain values."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from mjrun.camera import script
from mjrun.document.yaml_writer import decimal, number
from mjrun.errors import UsageError, quoted

Plain = dict[str, Any]


def written(camera: script.Script) -> Plain:
    """The document of `camera`, as it is written within a run document.

    Raises:
      UsageError: no document says this.
    """
    name = {} if camera.name == "script" else {"name": camera.name}
    return {**name, "shots": [_shot(shot, f"{camera.name}: shots[{i}]") for i, shot in enumerate(camera.shots)]}


def event(given: script.Event, what: str) -> Plain:
    """A moment, as in `{when: speed(box) > 0.02, nth: 2}`."""
    otherwise = given.otherwise if given.otherwise in (None, "end") else decimal(Fraction(given.otherwise), what)
    offset = None if not given.offset else decimal(given.offset, what)
    nth = None if given.nth == 1 else given.nth
    return known({"when": given.when, "nth": nth, "offset": offset, "else": otherwise})


def known(given: Mapping[str, Any]) -> Plain:
    """What is not None."""
    return {key: value for key, value in given.items() if value is not None}


def _shot(shot: script.Shot, what: str) -> Plain:
    until = event(shot.until, what) if isinstance(shot.until, script.Event) else _time(shot.until, what)
    return known(
        {
            **_rig(shot.rig, what),
            "until": until,
            "duration": _time(shot.lasting, what),
            "speed": _time(shot.speed, what),
            "blend": shot.blend and _changed(shot.blend, script.Blend()),
            "roll": None if shot.roll == script.Ramp.still(0) else _sliding(shot.roll),
            "fovy": _sliding(shot.fovy),
            "shake": shot.shake and _changed(shot.shake, script.Shake()),
            "fit": shot.fit and _fit(shot.fit),
        }
    )


def _rig(rig: script.Rig, what: str) -> Plain:
    match rig:
        case script.ModelRig():
            return {"camera": rig.camera}
        case script.LookRig():
            return {"look": {"from": _place(rig.eye), "at": _place(rig.target)}}
        case script.PathRig():
            settings = {key: getattr(rig, key) for key in ("curve", "pace", "ease")}
            usual = {"curve": "spline", "pace": "constant", "ease": "linear"}
            said = {key: value for key, value in settings.items() if value != usual[key]}
            points = [_waypoint(point) for point in rig.waypoints]
            return {"path": known({"lookat": _place(rig.lookat), **said, "waypoints": points})}
    return _around(rig, what)


def _around(rig: script.AroundRig, what: str) -> Plain:
    ramps = known({key: _sliding(getattr(rig, key)) for key in ("distance", "azimuth", "elevation")})
    aimed = known({"lookat": _place(rig.target), **ramps})
    steered = rig.heading or any(rig.offset)
    if (rig.turn and (steered or rig.azimuth is not None)) or (steered and not isinstance(rig.target, str)):
        raise UsageError(f"{what}: no document says this of a camera: {quoted(str(rig))}")
    turning = rig.turn or (rig.azimuth is not None and rig.azimuth.start != rig.azimuth.end)
    if turning and not steered:
        ease = {} if rig.turn in (None, "linear") else {"ease": rig.turn}
        return {"orbit": {**aimed, **ease}}
    if not isinstance(rig.target, str):
        return {"free": aimed}
    heading = {"heading": True} if rig.heading else {}
    offset = {"offset": _place(rig.offset)} if any(rig.offset) else {}
    return {"track": {"target": rig.target, **ramps, **heading, **offset}}


def _waypoint(point: script.Waypoint) -> Plain:
    numbers = {key: getattr(point, key) for key in ("distance", "azimuth", "elevation", "at")}
    said = {key: None if value is None else number(value) for key, value in numbers.items()}
    return known({"eye": _place(point.eye), **said, "lookat": _place(point.lookat)})


def _place(place: script.Place | None) -> str | Sequence[float] | None:
    return place if place is None or isinstance(place, str) else [number(value) for value in place]


def _sliding(ramp: script.Ramp | None) -> float | Plain | None:
    if ramp is None or ramp == script.Ramp.still(ramp.start):
        return None if ramp is None else number(ramp.start)
    ease = {} if ramp.ease == "linear" else {"ease": ramp.ease}
    return {"from": number(ramp.start), "to": number(ramp.end), **ease}


def _time(value: Fraction | None, what: str) -> float | None:
    return None if value is None else decimal(value, what)


def _changed(given: Any, usual: Any) -> Plain:
    """The fields of `given` that are not as in `usual`."""
    fields = {key: value for key, value in vars(given).items() if value != getattr(usual, key)}
    return {key: value if isinstance(value, str) else number(value) for key, value in fields.items()}


def _fit(fit: script.Fit) -> str | Plain:
    return fit.target if fit == script.Fit(fit.target) else {"target": fit.target, "margin": number(fit.margin)}
