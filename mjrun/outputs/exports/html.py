"""HTML: a page that replays the simulation in 3D, with curves and marks over a time line, without network access.

The page holds three files as base64 of gzip: the viewer, whose source is in scripts/replay; the scene, a GLB; and data
that accompanies it, JSON followed by the arrays that it refers to. A content security policy permits only the scripts
and the style of the page, by their hashes, and no request.
"""

import base64
import gzip
import hashlib
import io
import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, cast

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.formats.glb import write_glb
from mjrun.outputs.event_detection import TimelineMark
from mjrun.outputs.export import FrameContacts, SceneToExport
from mjrun.palette import ON_DARK, ON_LIGHT, css
from mjrun.plotting.html_page import Markup, element
from mjrun.probe.select import select, split

VIEWER = Path(__file__).with_name("replay")
_LEVEL = 6
_ALIGNMENT = 8  # bytes
_DTYPES = {"f4": np.float32, "f8": np.float64, "u4": np.uint32}


@dataclass(frozen=True)
class ReplayCurve:
    """A curve: its name, unit and values."""

    name: str
    unit: str
    values: np.ndarray


@dataclass(frozen=True)
class ReplayPanel:
    """Curves over the same axis."""

    title: str
    unit: str
    curves: Sequence[ReplayCurve]


@dataclass(frozen=True)
class Replay:
    """The content of a page that replays a simulation.

    Attributes:
      title, subtitle: text of its header.
      maker: the program, with its version.
      times: simulated times of the frames [s].
      direction: azimuth and elevation of the free view, as of MuJoCo's free camera [rad]; None for a usual one.
      panels: curves.
      curve_times: simulated times of the values of all curves [s]; None for those of the frames.
      marks: events and assertions.
      contacts: contacts; None if they were not recorded.
      layers: what is shown at first of `contactpoint`, `contactforce` and `labels`.
      facts: names and values for the reader.
    """

    title: str
    subtitle: str
    maker: str
    times: np.ndarray
    direction: tuple[float, float] | None = None
    panels: Sequence[ReplayPanel] = ()
    curve_times: np.ndarray | None = None
    marks: Sequence[TimelineMark] = ()
    contacts: FrameContacts | None = None
    layers: Sequence[str] = ()
    facts: Sequence[tuple[str, str]] = ()


def replay_page(replay: Replay, glb: bytes) -> bytes:
    """Returns the page of a replay, whose frames are those of the animation of `glb`."""
    viewer = (VIEWER / "viewer.js.gz").read_bytes()
    boot, style = ((VIEWER / name).read_bytes() for name in ("boot.js", "viewer.css"))
    policy = (
        f"default-src 'none'; script-src {_hash(boot)} {_hash(gzip.decompress(viewer))}; style-src {_hash(style)}; "
        "base-uri 'none'; form-action 'none'"
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1, viewport-fit=cover"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", name="generator", content=replay.maker),
        element("title", replay.title),
        element("style", Markup(style.decode())),
    )
    body = element(
        "body",
        element("p", "Loading …", id="status"),
        element("noscript", element("p", "This replay needs JavaScript.")),
        _embedded("viewer", viewer),
        _embedded("scene", gzip.compress(glb, _LEVEL, mtime=0)),
        _embedded("data", gzip.compress(_data(replay), _LEVEL, mtime=0)),
        element("script", Markup(boot.decode())),
    )
    return f"<!doctype html>\n{element('html', head, body, lang='en')}\n".encode()


def _hash(script: bytes) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"


def _embedded(name: str, compressed: bytes) -> Markup:
    return element("script", Markup(base64.b64encode(compressed).decode()), id=name, type="application/gzip")


def _data(replay: Replay) -> bytes:
    """Returns the length of JSON, the JSON, and arrays aligned to 8 bytes."""
    blocks: list[bytes] = []

    def placed(values: np.ndarray, dtype: str) -> dict[str, object]:
        block = np.ascontiguousarray(values, np.dtype(_DTYPES[dtype]).newbyteorder("<")).tobytes()
        offset = sum(map(len, blocks))
        blocks.append(block + bytes(-len(block) % _ALIGNMENT))
        return {"dtype": dtype, "offset": offset, "length": int(values.size)}

    contacts = replay.contacts
    content: dict[str, object] = {
        "title": clean(replay.title),
        "subtitle": clean(replay.subtitle),
        "times": placed(replay.times, "f8"),
        "direction": replay.direction,
        "curveTimes": placed(replay.times if replay.curve_times is None else replay.curve_times, "f8"),
        "panels": [
            {
                "title": clean(panel.title),
                "unit": clean(panel.unit),
                "curves": [
                    {"name": clean(curve.name), "unit": clean(curve.unit), "values": placed(curve.values, "f4")}
                    for curve in panel.curves
                ],
            }
            for panel in replay.panels
        ],
        "marks": [{"time": mark.time, "kind": mark.kind, "text": clean(mark.text)} for mark in replay.marks],
        "contacts": contacts and {"counts": placed(contacts.counts, "u4"), "values": placed(contacts.values, "f4")},
        "layers": [*replay.layers],
        "facts": [[clean(name), clean(value)] for name, value in replay.facts],
        "colors": {"light": [*map(css, ON_LIGHT)], "dark": [*map(css, ON_DARK)]},
    }
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
    return b"".join([struct.pack("<I", len(text)), text, bytes(-(len(text) + 4) % _ALIGNMENT), *blocks])


def write_page(scene: SceneToExport, file: BinaryIO) -> None:
    """Writes the page."""
    contacts = scene.contacts
    glb = io.BytesIO()
    for text in write_glb(glb, scene.graph, scene.motion, {}, scene.generator):
        scene.context.reporter.warn(text)
    replay = Replay(
        title=Path(scene.context.simulation.source.text).stem,
        subtitle=_subtitle(scene),
        maker=scene.generator,
        times=np.array(scene.recorded_scene.times),
        direction=_direction(scene),
        panels=list(curve_panels(scene)),
        curve_times=scene.values.rows[:, 0].copy() if scene.values else None,
        marks=scene.marks,
        contacts=contacts if contacts and len(contacts.values) else None,
        layers=scene.layers,
        facts=_facts(scene),
    )
    file.write(replay_page(replay, glb.getvalue()))


def _subtitle(scene: SceneToExport) -> str:
    if len(scene.recorded_scene.times) == 1:
        return ""
    rate = float(scene.request.fps / scene.request.speed)
    return f"{float(scene.context.timeline.duration):g} s, {rate:g} frames per second"


def _direction(scene: SceneToExport) -> tuple[float, float] | None:
    """Returns azimuth and elevation of the model's free camera [rad], unless they are MuJoCo's defaults."""
    chosen = scene.context.model.vis.global_
    usual = mujoco.MjSpec().visual.global_
    if (chosen.azimuth, chosen.elevation) == (usual.azimuth, usual.elevation):
        return None
    return math.radians(chosen.azimuth), math.radians(chosen.elevation)


def curve_panels(scene: SceneToExport) -> Iterator[ReplayPanel]:
    """Yields a panel for each use of the option plot, with the columns that it selects."""
    values = scene.values
    if values is None:
        return
    rows = values.rows.T.astype(np.float32)  # as the page holds them, read once
    stored = {column.name: row for column, row in zip(values.columns, rows, strict=True)}
    for text in scene.request.plot:
        probes = select(scene.context.model, split(text), scene.context.episode)
        columns = [column for probe in probes for column in probe.columns]
        units = {column.unit for column in columns}
        curves = [ReplayCurve(column.name, column.unit, stored[column.name]) for column in columns]
        groups = dict.fromkeys(column.name.partition("/")[0] for column in columns)
        yield ReplayPanel(", ".join(groups), units.pop() if len(units) == 1 else "", curves)


def _facts(scene: SceneToExport) -> Sequence[tuple[str, str]]:
    """Returns the main facts of the manifest, as a reader needs them."""
    facts = scene.facts
    model = cast("Mapping[str, object]", facts["model"])
    pairs = {
        "Command": facts.get("command"),
        "Model": model.get("path"),
        "SHA-256 of the compiled model": model.get("sha256"),
        "Versions": f"{scene.generator}, numpy {facts['numpy']}, Python {facts['python']}",
        "Machine": facts.get("machine"),
        "Seed": facts.get("seed"),
        "Timestep": f"{facts['timestep']} s",
    }
    return [(name, str(value)) for name, value in pairs.items() if value not in (None, "")]
