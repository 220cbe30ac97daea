"""Actuators, sensors, cameras and lights as `mjrun info` shows them: columns of text."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mjrun.cli.table_cells import (
    Column,
    common,
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
    from mjrun.model.description.actuators import Actuator
    from mjrun.model.description.cameras_lights import Camera, Light
    from mjrun.model.description.sensors import Sensor

PLAIN = ("joint", "tendon", "site", "body", "so3")  # transmissions that follow from the target


def actuators(rows: Sequence["Actuator"]) -> list[Column]:
    gears = [common(vector(gear) or "0" for gear in row.gear) for row in rows]
    gains = ["" if row.kind == "motor" else _law(row.gain, "fixed", row.gain_parameters) for row in rows]
    kinds = {row.target_kind for row in rows}
    return [
        texts("name", [row.name for row in rows]),
        texts("kind", [row.kind for row in rows]),
        Column(f"acts on {kinds.pop()}" if len(kinds) == 1 else "acts on", [_target(row, not kinds) for row in rows]),
        Column("ctrl", [slots(row.ctrl, row.ctrl_size) for row in rows], right=True),
        Column("ctrl range", [common(map(span, row.ctrl_range)) for row in rows], right=True),
        Column("gear", [] if set(gears) == {"1"} else gears, right=True, extra=True),
        ranges("force range", [row.force_range for row in rows], [row.force_unit for row in rows], extra=True),
        Column("act", [slots(row.act, row.act_size) for row in rows], right=True, extra=True),
        ranges("act range", [row.act_range for row in rows], [], extra=True),
        Column("gain", gains, right=True, extra=True),
        Column("bias", [_law(row.bias, "affine", row.bias_parameters) for row in rows], extra=True),
        Column("dynamics", [_law(row.dynamics, "", row.dynamics_parameters) for row in rows], extra=True),
        numbers("delay", [row.delay for row in rows], "s", extra=True),
        numbers("group", [row.group for row in rows], extra=True),
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
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        Column("of", [reference(row.object_kind, row.object) for row in rows]),
        Column("relative to", [reference(row.reference_kind, row.reference) for row in rows]),
        Column("sensordata", [slots(row.address, row.dim) for row in rows], right=True, extra=True),
        texts("unit", [row.unit for row in rows]),
        numbers("cutoff", [row.cutoff for row in rows], extra=True),
        numbers("noise", [row.noise for row in rows], extra=True),
        numbers("delay", [row.delay for row in rows], "s", extra=True),
        numbers("period", [row.period for row in rows], "s", extra=True),
        texts("plugin", [row.plugin for row in rows], extra=True),
    ]


def cameras(rows: Sequence["Camera"]) -> list[Column]:
    has_resolution = any(row.resolution != (1, 1) for row in rows)
    return [
        texts("name", [row.name for row in rows]),
        texts("body", [row.body for row in rows]),
        Column("mode", [_mode(row) for row in rows]),
        numbers("fovy", [row.fovy for row in rows], "°"),
        numbers("height", [row.height for row in rows], "m"),
        Column("", ["" if row.projection == "perspective" else row.projection for row in rows]),
        vectors("sensor", [row.sensor_size for row in rows], "m", extra=True),
        vectors("focal length", [row.focal_length for row in rows], "m", extra=True),
        Column(
            "resolution",
            ["x".join(map(str, row.resolution)) if row.resolution != (1, 1) else "" for row in rows],
            "px",
            extra=True,
        ),
        vectors("position", [row.position for row in rows], "m", extra=True),
        Column("outputs", [" ".join(row.outputs) if has_resolution else "" for row in rows], extra=True),
    ]


def _mode(row: "Camera | Light") -> str:
    return f"{row.mode} {clean(row.target)}" if row.target else row.mode


def lights(rows: Sequence["Light"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        texts("body", [row.body for row in rows]),
        Column("mode", [_mode(row) for row in rows]),
        Column("", ["" if row.active else "off" for row in rows]),
        Column("shadow", ["yes" if row.shadow else "no" for row in rows]),
        vectors("position", [row.position for row in rows], "m", extra=True),
    ]
