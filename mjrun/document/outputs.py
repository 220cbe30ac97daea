"""What a run document makes of its simulation: films, stills, traces, plots and a recording."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, Tag

from mjrun.document.camera import Event
from mjrun.document.document_model import MAPPING, NUMBER, TEXT, Among, Form, Loc, Maybe, Name, kinds
from mjrun.document.field_types import Exact, Instant, Several, Size, all_of
from mjrun.document.machine import Machine
from mjrun.document.output_folder import Inside
from mjrun.document.simulation import Whole
from mjrun.document.view import Picture
from mjrun.job import plot
from mjrun.job.image import Image
from mjrun.job.plot import Plot
from mjrun.job.recording import Recording
from mjrun.job.simulation import Simulation
from mjrun.job.trace import Trace
from mjrun.job.video import Video
from mjrun.probe.select import DEFAULT, split
from mjrun.rendering.graph import SIDES
from mjrun.rendering.process_count import AUTO

Positives = Annotated[int, Field(gt=0)]


class Film(Picture):
    """A film."""

    output: Inside
    """mp4, webm, mkv, mov, gif, apng, webp, or PNGs (frames/, frame_%04d.png), inside the folder of outputs."""
    fps: Maybe[Exact] = None
    """Frames per second of the film [Hz], as in 60 or 30000/1001; 30 if left out, 25 in a GIF."""
    speed: Exact = Field(1, validate_default=True)
    """Simulated seconds per second of film: 0.25 is slow motion."""
    format: Maybe[Name] = None
    """Instead of the output's suffix."""
    codec: Maybe[Name] = None
    """h264, h265, av1, vp9, prores, ffv1, as the format holds."""
    crf: Maybe[int] = None
    """Constant rate factor: lower is better and larger."""
    preset: Maybe[
        Annotated[Annotated[Name, Tag(TEXT)] | Annotated[int, Tag(NUMBER)], kinds("the name of a preset", TEXT, NUMBER)]
    ] = None
    """The codec's own, from fast to thorough."""
    plot: Several[Name] = Field([])
    """Live graphs of what a trace would measure: energy, "qpos[left_*]"; a list for several graphs."""
    plot_side: Annotated[str, Among(SIDES)] = "under"
    """Where graphs stand."""
    jobs: Annotated[
        Annotated[Positives, Tag(NUMBER)] | Annotated[Literal["auto"], Tag(TEXT)],
        kinds("a number of processes, or auto", NUMBER, TEXT),
    ] = AUTO
    """Processes that draw; auto is one per core where a CPU draws a long film."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        if given.get("plot") and given.get("separate") is True:
            yield ("separate",), "a plot stands under one picture, and separate makes several"

    def job(self, simulation: Simulation, files: Mapping[str, Any], inputs: Path, machine: Machine) -> Video:
        """The job; `files` are its outputs, by key."""
        same = ("fps", "speed", "format", "codec", "crf", "plot_side")
        return Video(
            simulation,
            **files,
            **self.drawing(inputs, machine),
            plot=all_of(self.plot),
            preset=None if self.preset is None else str(self.preset),
            jobs=self.jobs if machine.jobs is None else machine.jobs,
            **{name: getattr(self, name) for name in same},
        )


class Still(Picture):
    """A picture of one instant."""

    output: Inside
    """png, jpg, webp, tiff; depth also npy, exr; segmentation also npy, json (COCO); inside the folder of outputs."""
    at: Maybe[
        Annotated[
            Annotated[Instant, Tag(NUMBER)] | Annotated[Instant, Tag(TEXT)] | Annotated[Event, Tag(MAPPING)],
            kinds("a time [s] or {when, nth, offset, else}", NUMBER, TEXT, MAPPING),
        ]
    ] = None
    """The instant: a time [s] of the simulation, or an event; its beginning if left out."""
    step: Maybe[Whole] = None
    """The instant, by step."""
    format: Maybe[Name] = None
    """Instead of the output's suffix; palette for a segmentation in colours."""
    legend: bool = True
    """Whether a coloured segmentation lists what it shows."""
    pointcloud: Maybe[Inside] = None
    """A .ply file for all that the cameras see as coloured points in the world [m]; labelled if seg is a view."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        if "at" in given and "step" in given:
            yield ("step",), "at and step exclude each other: both say when"

    def job(self, simulation: Simulation, files: Mapping[str, Any], inputs: Path, machine: Machine) -> Image:
        """The job; `files` are its outputs, by key."""
        return Image(
            simulation,
            **files,
            **self.drawing(inputs, machine),
            at=self.at.event() if isinstance(self.at, Event) else self.at,
            step=self.step,
            format=self.format,
            legend=self.legend,
        )


class Sampled(Form):
    """What measures again and again."""

    output: Inside
    """The file, inside the folder of outputs."""
    every: Positives = 1
    """Steps between samples."""
    rate: Maybe[Exact] = None
    """Samples per simulated second [Hz], instead of every."""
    format: Maybe[Name] = None
    """Instead of the output's suffix."""
    manifest: Maybe[Inside] = None
    """A file for what made the output, as JSON."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        if "every" in given and "rate" in given:
            yield ("rate",), "every and rate exclude each other: both say how often"


class Table(Sampled):
    """A table of measured values, a row per instant."""

    output: Inside
    """csv, jsonl, parquet, feather, npz or mat, inside the folder of outputs."""
    probe: Several[Name] = Field(list(DEFAULT))
    """What to measure: qpos, energy, contact, "qpos[left_*]", xpos/hand/z; or a list."""
    asserts: Several[Name] = Field([], alias="assert")
    """What must hold: max(abs(energy/drift)) < 1e-3; or a list."""
    contacts: Maybe[Inside] = None
    """A second table, a row for each contact of each instant: where [m], force [N] and torque [N m]."""
    keep_partial: bool = False
    """Whether the rows before an instability are kept."""

    def job(self, simulation: Simulation, files: Mapping[str, Any], inputs: Path, machine: Machine) -> Trace:
        """The job; `files` are its outputs, by key."""
        return Trace(
            simulation,
            **files,
            format=self.format,
            probes=tuple(name for text in all_of(self.probe) for name in split(text)),
            every=self.every,
            rate=self.rate,
            asserts=all_of(self.asserts),
            keep_partial=self.keep_partial,
            command=machine.command,
        )


class Graphs(Sampled):
    """Measured values over time, as a picture."""

    output: Inside
    """png, jpg, webp or tiff, inside the folder of outputs."""
    probe: Several[Name]
    """What to plot: energy, "qpos[left_*],qvel/hip"; a list for several graphs, one under the other."""
    size: Size = plot.SIZE
    """Width and height of the picture [pixels], 1280x720 or [1280, 720]."""

    def job(self, simulation: Simulation, files: Mapping[str, Any], inputs: Path, machine: Machine) -> Plot:
        """The job; `files` are its outputs, by key."""
        same = ("size", "every", "rate", "format")
        given = {name: getattr(self, name) for name in same}
        return Plot(simulation, **files, probes=all_of(self.probe), command=machine.command, **given)


class Kept(Form):
    """The states of all steps, for replay."""

    output: Inside
    """An .npz file, inside the folder of outputs."""
    keep_partial: bool = False
    """Whether the states before an instability are kept."""
    manifest: Maybe[Inside] = None
    """A file for what made the recording, as JSON."""

    def job(self, simulation: Simulation, files: Mapping[str, Any], inputs: Path, machine: Machine) -> Recording:
        """The job; `files` are its outputs, by key."""
        return Recording(simulation, **files, keep_partial=self.keep_partial, command=machine.command)
