"""Binary glTF: scene and motion in one file, for Blender, game engines and viewers."""

from typing import TYPE_CHECKING, BinaryIO

from mjrun.outputs.exports import ExportFormat

if TYPE_CHECKING:
    from mjrun.outputs.export import SceneToExport


def write(scene: "SceneToExport", file: BinaryIO) -> None:
    """Writes the scene with its motion."""
    from mjrun.formats.glb import write_glb

    for text in write_glb(file, scene.graph, scene.motion, {"mjrun": scene.facts}, scene.generator):
        scene.context.reporter.warn(text)


FORMAT = ExportFormat("glb", (".glb",), "binary glTF with scene and motion", write)
