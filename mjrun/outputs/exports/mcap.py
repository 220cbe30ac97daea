"""MCAP: a log with Foxglove's messages, for Foxglove, Rerun and PlotJuggler."""

from typing import TYPE_CHECKING, BinaryIO

from mjrun.options.trace import PROBES
from mjrun.outputs.exports import ExportFormat

if TYPE_CHECKING:
    from mjrun.outputs.export import SceneToExport


def write(scene: "SceneToExport", file: BinaryIO) -> None:
    """Writes the simulation as messages."""
    from mjrun.outputs.mcap_export import write_mcap

    write_mcap(scene, file)


FORMAT = ExportFormat(
    name="mcap",
    suffixes=(".mcap",),
    description="log for Foxglove, Rerun and PlotJuggler",
    write=write,
    cameras=(),
    draws=True,
    columns="probe",
    probes=PROBES,
    libraries=("mcap", "foxglove_schemas_protobuf", "google.protobuf"),
    extra="mcap",
)
