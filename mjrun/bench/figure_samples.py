"""The figures of a benchmark that are compared with a baseline: their samples, read from JSON."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjrun.bench.statistics import median

FigureId = tuple[str, str]  # its name, and the device if that is not the processor
Document = Mapping[str, Any]  # a benchmark as JSON


@dataclass(frozen=True)
class FigureSamples:
    """Wall times [s] of one figure, and of the reference workload in the same turns, if it was timed."""

    times: Sequence[float]
    workload: Sequence[float] | None

    @classmethod
    def read(cls, statistics: Document, workload: Document | None) -> "FigureSamples":
        """From `SampleStatistics` as JSON."""
        times = _positive(statistics["samples"])
        if workload is None:
            return cls(times, None)
        workload_times = _positive(workload["samples"])
        if len(workload_times) != len(times):
            raise ValueError("the reference workload needs as many samples as the figure")
        return cls(times, workload_times)

    @property
    def median(self) -> float:
        """Of the wall times [s]."""
        return median(self.times)

    def quotients(self, workload: Sequence[float]) -> list[float]:
        """The wall times, each divided by that of the workload in the same turn."""
        return [time / reference for time, reference in zip(self.times, workload, strict=True)]


def figures(document: Document) -> Iterator[tuple[FigureId, FigureSamples]]:
    """All figures that are compared."""
    for row in document["rows"]:
        yield from figures_of_row(row)
    for frame in document["frames"]:
        (width, height), renderer = frame["size"], frame["renderer"]
        name = f"{frame['view']} {width}x{height} {frame['quality']}" + f" {renderer}" * (renderer != "classic")
        yield (name, frame["device"]), FigureSamples.read(frame["total"], frame.get("reference_workload"))


def figures_of_row(row: Document) -> Iterator[tuple[FigureId, FigureSamples]]:
    """The figures of a point of the grid."""
    point = "".join(f" {path}={value}" for path, value in row["point"].items())
    if row["step"] is not None:
        yield (f"step{point}", ""), FigureSamples.read(row["step"], row.get("reference_workload"))
    for threads in row["threads"]:
        if threads["threads"] > 1:
            name = f"threads {threads['threads']}{point}"
            yield (name, ""), FigureSamples.read(threads["step"], threads.get("reference_workload"))


def _positive(samples: Sequence[Any]) -> list[float]:
    times = [float(sample) for sample in samples]
    if not times or min(times) <= 0:
        raise ValueError("samples must be positive")
    return times
