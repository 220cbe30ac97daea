"""What `mjrun info` shows of what acts, measures and sees: columns of text."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mjrun.cli.info_formatting import (
    Column,
    common,
    names,
    numbers,
    ranges,
    reference,
    slots,
    span,
    texts,
    vector,
    vectors,
)
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.description.model_description import Actuator, Camera, Plugin, Sensor

PLAIN = ("joint", "tendon", "site", "body", "so3")  # transmissions that the target tells


def actuators(rows: Sequence["Actuator"]) -> list[Column]:
    gears = [common(vector(gear) or "0" for gear in row.gear) for row in rows]
    gains = ["" if row.kind == "motor" else _law(row.gain, "fixed", row.gain_parameters) for row in rows]
    kinds = {row.target_kind for row in rows}
    return [
        names(rows),
        texts("kind", rows, "kind"),
        Column(f"acts on {kinds.pop()}" if len(kinds) == 1 else "acts on", [_target(row, not kinds) for row in rows]),
        Column("ctrl", [slots(row.ctrl, row.ctrl_size) for row in rows], right=True),
        Column("ctrl range", [common(map(span, row.ctrl_range)) for row in rows], right=True),
        Column("gear", [] if set(gears) == {"1"} else gears, right=True, extra=True),
        ranges("force range", rows, "force_range", "force_unit", extra=True),
        Column("act", [slots(row.act, row.act_size) for row in rows], right=True, extra=True),
        ranges("act range", rows, "act_range", None, extra=True),
        Column("gain", gains, right=True, extra=True),
        Column("bias", [_law(row.bias, "affine", row.bias_parameters) for row in rows], extra=True),
        Column("dynamics", [_law(row.dynamics, "", row.dynamics_parameters) for row in rows], extra=True),
        numbers("delay", rows, "delay", "s", extra=True),
        numbers("group", rows, "group", extra=True),
    ]


def _target(row: "Actuator", bare: bool) -> str:
    """What an actuator acts on; `bare` without its kind."""
    target = clean(row.target or "") if bare else reference(row.target_kind, row.target)
    origin = f" from {clean(row.reference)}" if row.reference else ""
    by = "" if row.transmission in PLAIN else f" ({row.transmission})"
    return f"{target}{origin}{by}"


def _law(kind: str, usual: str, parameters: Sequence[float]) -> str:
    """The parameters of a gain, bias or dynamics, after its type where that is not the usual one."""
    return "" if kind == "none" else " ".join(filter(None, ("" if kind == usual else kind, vector(parameters))))


def sensors(rows: Sequence["Sensor"]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        Column("of", [reference(row.object_kind, row.object) for row in rows]),
        Column("relative to", [reference(row.reference_kind, row.reference) for row in rows]),
        Column("sensordata", [slots(row.address, row.dim) for row in rows], right=True, extra=True),
        texts("unit", rows, "unit"),
        numbers("cutoff", rows, "cutoff", extra=True),
        numbers("noise", rows, "noise", extra=True),
        numbers("delay", rows, "delay", "s", extra=True),
        numbers("period", rows, "period", "s", extra=True),
        texts("plugin", rows, "plugin", extra=True),
    ]


def cameras(rows: Sequence["Camera"]) -> list[Column]:
    meant = [row.resolution != (1, 1) for row in rows]
    return [
        names(rows),
        texts("body", rows, "body"),
        Column("mode", [_mode(row) for row in rows]),
        numbers("fovy", rows, "fovy", "°"),
        numbers("height", rows, "height", "m"),
        Column("", ["" if row.projection == "perspective" else row.projection for row in rows]),
        vectors("sensor", rows, "sensor_size", "m", extra=True),
        vectors("focal length", rows, "focal_length", "m", extra=True),
        Column(
            "resolution",
            ["x".join(map(str, row.resolution)) if told else "" for row, told in zip(rows, meant, strict=True)],
            "px",
            extra=True,
        ),
        vectors("position", rows, "position", "m", extra=True),
        Column("outputs", [" ".join(row.outputs) if any(meant) else "" for row in rows], extra=True),
    ]


def _mode(row: Any) -> str:
    return f"{row.mode} {clean(row.target)}" if row.target else row.mode


def lights(rows: Sequence[Any]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        texts("body", rows, "body"),
        Column("mode", [_mode(row) for row in rows]),
        Column("", ["" if row.active else "off" for row in rows]),
        Column("shadow", ["yes" if row.shadow else "no" for row in rows]),
        vectors("position", rows, "position", "m", extra=True),
    ]


def plugins(rows: Sequence["Plugin"]) -> list[Column]:
    return [
        names(rows),
        texts("plugin", rows, "plugin"),
        Column("computes", [", ".join(map(clean, row.users)) for row in rows]),
        Column("settings", [clean(", ".join(f"{k}={v}" for k, v in row.settings.items())) for row in rows]),
        numbers("state", rows, "state"),
    ]


DEVICES = {
    "actuators": actuators, "sensors": sensors, "cameras": cameras, "lights": lights, "plugins": plugins,
}  # fmt: skip
