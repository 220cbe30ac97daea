"""USD: scene and motion for Omniverse, Houdini, Maya, Blender and, as a package, for Apple devices."""

from typing import TYPE_CHECKING, BinaryIO

from mjrun.outputs.exports import ExportFormat, format_named

if TYPE_CHECKING:
    from mjrun.outputs.export import SceneToExport


def write(scene: "SceneToExport", file: BinaryIO) -> None:
    """Writes the scene with its motion."""
    from pathlib import Path

    from mjrun.formats.usd import write_usd

    suffix = Path(scene.request.output).suffix.lower()
    kind = suffix if suffix in FORMAT.suffixes else format_named(scene.request.format or FORMAT.name)[1]
    for text in write_usd(file, kind, scene.graph, scene.motion, float(scene.request.fps), scene.facts):
        scene.context.reporter.warn(text)


FORMAT = ExportFormat(
    "usd",
    (".usdc", ".usda", ".usdz", ".usd"),
    "OpenUSD with scene and motion, as binary, text or package",
    write,
    libraries=("pxr",),
    extra="usd",
)
