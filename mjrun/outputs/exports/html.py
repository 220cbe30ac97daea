"""HTML: a page that replays the simulation in 3D, with curves and marks over a time line, without network access."""

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, cast

import mujoco
import numpy as np

from mjrun.formats.glb import write_glb
from mjrun.outputs.export import SceneToExport
from mjrun.plotting.replay_page import Replay, ReplayContacts, ReplayCurve, ReplayMark, ReplayPanel, replay_page
from mjrun.probe.select import select, split


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
        panels=list(_panels(scene)),
        curve_times=scene.values.rows[:, 0] if scene.values else None,
        marks=[ReplayMark(mark.time, mark.kind, mark.text) for mark in scene.marks],
        contacts=ReplayContacts(contacts.counts, contacts.values) if contacts and len(contacts.values) else None,
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


def _panels(scene: SceneToExport) -> Iterator[ReplayPanel]:
    """Yields a panel for each use of the option plot, with the columns that it selects."""
    values = scene.values
    if values is None:
        return
    places = {column.name: index for index, column in enumerate(values.columns)}
    for text in scene.request.plot:
        probes = select(scene.context.model, split(text), scene.context.episode)
        columns = [column for probe in probes for column in probe.columns]
        units = {column.unit for column in columns}
        curves = [ReplayCurve(column.name, column.unit, values.rows[:, places[column.name]]) for column in columns]
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
