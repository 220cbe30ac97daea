"""Files of scenes with motion: binary glTF for Blender, game engines and viewers, and USD for Omniverse and others."""

from pathlib import Path
from typing import BinaryIO

from mjrun.formats.glb import write_glb
from mjrun.outputs.export import SceneToExport
from mjrun.outputs.exports import format_named


def write_glb_file(scene: SceneToExport, file: BinaryIO) -> None:
    """Writes the scene with its motion as binary glTF."""
    for text in write_glb(file, scene.graph, scene.motion, {"mjrun": scene.facts}, scene.generator):
        scene.context.reporter.warn(text)


def write_usd_file(scene: SceneToExport, file: BinaryIO) -> None:
    """Writes the scene with its motion as OpenUSD."""
    from mjrun.formats.usd import write_usd  # which needs a library

    form, suffix = scene.request.file_format, Path(scene.request.output).suffix.lower()
    kind = suffix if suffix in form.suffixes else format_named(scene.request.format or form.name)[1]
    for text in write_usd(file, kind, scene.graph, scene.motion, float(scene.request.fps), scene.facts):
        scene.context.reporter.warn(text)
