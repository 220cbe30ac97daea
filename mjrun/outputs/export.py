"""Export output: the scene of a simulation, with its motion, in a format of other programs."""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, BinaryIO

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, concerning, listing, option
from mjrun.formats.output_writer import OutputWriter, StagedFile, StandardOutput
from mjrun.model.names import enum_members
from mjrun.model.state import restore, widened
from mjrun.model.table_column import Column
from mjrun.options.export import ExportOptions
from mjrun.options.option import options, values_of
from mjrun.options.rendering import RendererOptions, SceneOptions
from mjrun.outputs import output
from mjrun.outputs.event_detection import EventAndAssertionDetector, TimelineMark
from mjrun.outputs.exports import FORMATS, ExportFormat, export_format, format_named
from mjrun.outputs.recorded_scene import (
    FrameSchedule,
    RecordedScene,
    SceneOutputRequest,
    ScenePlan,
    check_scene,
    open_states,
    place_scene,
    plan_scene,
    state_taps,
    video_schedule,
)
from mjrun.outputs.trace_rows import ROWS, ProbeSampler, RowBuffer, rate_warning
from mjrun.physics.recorded_states import SpooledRows
from mjrun.physics.simulation_loop import Tap
from mjrun.physics.stepper import Stepper, instants_of
from mjrun.probe.contacts import RecordedContacts, contact_copiers
from mjrun.probe.select import select, selected_columns, split
from mjrun.probe.verdict import Verdict
from mjrun.rendering.visual import visual_of
from mjrun.scene_graph.graph import CameraLens, Node, SceneGraph, SceneMotion, Track, camera_lens
from mjrun.scene_graph.recorder import CONTACTS, FLAGS, SceneContentSettings, compute_poses, record_scene
from mjrun.scene_graph.walk import matrix_quaternion, quaternion, vector

if TYPE_CHECKING:
    from mjrun.outputs.frame_drawing import FramePlan, FrameRecorder

NO_LABELS, BODY_LABELS = int(mujoco.mjtLabel.mjLABEL_NONE), int(mujoco.mjtLabel.mjLABEL_BODY)
DETAIL = {"draft": 0.5, "model": 1.0, "high": 2.0}  # triangles of circles by quality, relative to the model's
BLOCK = 64  # frames whose contacts are converted at once


@options
class Export(ExportOptions, SceneOutputRequest["ExportResult"]):
    """An export of a simulation: its options are keywords."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_scene(self)

    @property
    def keeps_partial(self) -> bool:
        return self.keep_partial

    @cached_property
    def file_format(self) -> ExportFormat:
        """The format of the file.

        Raises:
          UsageError: the format is unknown.
        """
        return export_format(self.output, self.format)

    @property
    def cameras(self) -> Sequence[object]:
        """The cameras that are added to those of the model."""
        return self.camera or self.file_format.cameras

    def check(self) -> None:
        """Checks the format, and the options that only some formats support.

        Raises:
          UsageError: the format is unknown, or does not support an option.
        """
        if self.file_format.product:
            raise UsageError(
                f"{option('format')} {self.file_format.name} is a folder of episodes, which mjrun export and "
                "mjrun.EpisodeDataset write",
                ("format",),
            )
        given = {
            "plot": bool(self.plot),
            "mark_event": bool(self.mark_event),
            "probe": bool(self.probe),
            "rate": self.rate is not None,
            "images": self.images is not None,
        }
        for name, is_given in given.items():
            if is_given and name not in self.file_format.options:
                able = [each.name for each in FORMATS.values() if name in each.options]
                hint = f"\nit applies to {listing(able)}" if able else ""
                raise UsageError(f"{option(name)} does not apply to {self.file_format.name}{hint}", path=(name,))
        if self.images is not None and not self.camera:
            raise UsageError(f"{option('images')} requires {option('camera')}", path=("images",))

    def schedule_frames(self, scene: ScenePlan, event_steps: output.EventSteps) -> FrameSchedule:
        """Schedules the frames, with the shots of cameras if there are any, and warns about those that are not shown.

        Raises:
          UsageError: an event does not happen, or the schedule is impossible.
        """
        timeline = scene.context.timeline
        if not scene.scripts:
            steps = timeline.frame_steps(self.fps, self.speed)
            times = [float(k / self.fps) for k in range(len(steps))]
            return FrameSchedule(steps, times, [float(self.speed)] * len(steps), [], timeline)
        schedule = video_schedule(scene.scripts, timeline, event_steps, fps=self.fps, speed=self.speed)
        for text in schedule.warnings:
            scene.context.reporter.warn(text)
        return schedule

    def plan(self, context: output.PassContext) -> "output.OutputPlan[ExportResult]":
        """Resolves every name in the model and schedules the frames unless events decide."""
        images = self._images(context) if self.renderer_options else None
        scene = images.scene if images else plan_scene(self, context, self.cameras)
        schedule = None if scene.conditions else self.schedule_frames(scene, {})
        table, rows = self._table(context)
        count = None if schedule is None else len(schedule.steps)
        about = f"{self.file_format.name}, {float(self.fps):g} fps"
        detector = self._detector(context)
        content = ExportContent(scene, images, schedule, table, rows, detector)
        return output.OutputPlan(
            preview=output.OutputPreview("export", self.output, count, "frames", (), about),
            until=context.timeline.steps,
            open=partial(OpenExport, self, content),
            enable_flags=(table.model.opt.enableflags if table else 0) | (detector.enable_flags if detector else 0),
            conditions=scene.conditions,
        )

    @property
    def renderer_options(self) -> RendererOptions | None:
        return self if self.file_format.draws and self.camera else None

    @property
    def probes(self) -> Sequence[str]:
        """The values that the file holds."""
        columns = self.file_format.columns
        return {"plot": self.plot, "probe": self.probe}.get(columns, ()) or self.file_format.probes

    def _images(self, context: output.PassContext) -> "FramePlan":
        """Plans the images that the file holds."""
        from mjrun.outputs.frame_drawing import plan_frames  # which imports the renderers
        from mjrun.outputs.video import VideoInMemory

        values = values_of(self, SceneOptions)
        return plan_frames(VideoInMemory(self.simulation, "images/", separate=True, **values), context)

    def _detector(self, context: output.PassContext) -> EventAndAssertionDetector | None:
        """Parses the events and the assertions, if any."""
        if not (self.mark_event or self.assert_):
            return None
        return EventAndAssertionDetector(
            context.model, context.timeline, self.mark_event, self.assert_, context.episode
        )

    def _table(self, context: output.PassContext) -> tuple[ProbeSampler | None, Sequence[int] | None]:
        """Plans the measured values; their rows are at the frames unless a rate is set."""
        probes = [name for text in self.probes for name in split(text)]
        if not probes:
            return None, None
        for index, name in enumerate({"plot": self.plot, "probe": self.probe}[self.file_format.columns]):
            with concerning(self.file_format.columns, index):
                select(context.model, split(name), context.episode)
        if text := rate_warning(context.timeline, self.rate):
            context.reporter.warn(text)
        if self.plot:
            probes = _without_repeats(context, probes)
        table = ProbeSampler(context.model, list(dict.fromkeys(probes)), context.timeline, context.episode)
        return table, None if self.rate is None else context.timeline.rows(rate=self.rate)


def _without_repeats(context: output.PassContext, probes: Sequence[str]) -> list[str]:
    """Returns probes that give the same columns, each once: panels may share columns."""
    names, seen = list[str](), set[str]()
    for probe in probes:
        columns = [column.name for column in selected_columns(context.model, [probe], context.episode)]
        new = [column for column in columns if column not in seen]
        names += [probe] if new == columns else new
        seen.update(new)
    return names


@dataclass(frozen=True, eq=False)
class MeasuredValues:
    """Measured values, which are on the disk if they are many.

    Attributes:
      columns: the columns, `time` [s] first.
      steps: the step of each row.
    """

    columns: Sequence[Column]
    steps: Sequence[int]
    stored: SpooledRows

    @property
    def rows(self) -> np.ndarray:
        """All values, `(n, columns)`."""
        return self.stored.read(0, len(self.stored))

    def blocks(self) -> Iterator[tuple[Sequence[int], np.ndarray]]:
        """Yields the rows a few at a time: their steps `(n,)`, and their values `(n, columns)`."""
        for start in range(0, len(self.stored), ROWS):
            values = self.stored.read(start, ROWS)
            yield self.steps[start : start + len(values)], values


@dataclass(frozen=True, eq=False)
class FrameContacts:
    """The contacts at each frame.

    Attributes:
      counts: number of contacts at each frame.
      values: position [m], normal and force [N] of each contact, in the axes of the world, `(n, 9)` float32.
    """

    counts: np.ndarray
    values: np.ndarray


class ContactRecorder:
    """A recorder of the contacts at the instants of frames, which are on the disk if they are many. To be closed."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._structures, self._forces = list[bytes](), list[bytes]()  # of the contacts of the last instants
        self._counts: list[int] = []
        self._rows = SpooledRows(9)

    def record(self, stepper: Stepper) -> None:
        """Adds the contacts of the stepper's instant."""
        structures, forces = contact_copiers(stepper.instant())
        self._structures.append(structures())
        self._forces.append(forces())
        if len(self._structures) == BLOCK:
            self._convert()

    def contacts(self, count: int) -> FrameContacts:
        """Returns the contacts of the first `count` frames."""
        self._convert()
        counts = np.array(self._counts[:count], int)
        return FrameContacts(counts, self._rows.read(0, int(counts.sum())).astype(np.float32))

    def close(self) -> None:
        """Frees the recording."""
        self._rows.close()

    def _convert(self) -> None:
        if not self._structures:
            return
        contacts = RecordedContacts(self._model, self._structures, self._forces)
        forces = np.einsum("ni,nij->nj", contacts.wrenches[:, :3], contacts.contact_frames)
        self._rows.extend(np.column_stack([contacts.fields["pos"], contacts.contact_frames[:, 0], forces]))
        self._counts += contacts.counts.tolist()
        self._structures, self._forces = [], []


@dataclass(frozen=True)
class ExportResult(output.OutputResult):
    """The result of an export.

    Attributes:
      path: path of the file; `-` is standard output.
      format: name of the format.
      frames, fps, duration: number of frames, their rate, and length of the playback [s].
      simulated, steps: simulated time [s] and steps taken.
      size: size of the file [bytes].
      simulation_wall: wall time of stepping [s].
      assertions: each assertion with its value and verdict.
    """

    format: str
    frames: int
    fps: float
    duration: float
    simulated: float
    steps: int
    size: int
    simulation_wall: float
    assertions: Sequence[Verdict]


class SceneToExport:
    """A simulated scene that is ready to be written.

    Attributes:
      request: the options.
      context: the simulation, its model and its timeline.
      facts: the facts of the manifest.
      frames: the states of all frames, their times, the poses of the cameras, and the decorations.
      values: the measured values; None without any.
      marks: events, and assertions with their outcomes.
      contacts: the contacts of each frame; None if the format does not hold them.
    """

    def __init__(
        self,
        request: Export,
        plan: ScenePlan,
        recorded_scene: RecordedScene,
        images: "FrameRecorder | None",
        values: MeasuredValues | None,
        marks: Sequence[TimelineMark],
        contacts: FrameContacts | None,
        facts: Mapping[str, object],
    ) -> None:
        self.request, self.context, self.recorded_scene, self.facts = request, plan.context, recorded_scene, facts
        self.values, self.marks, self.contacts = values, marks, contacts
        self._plan, self._images = plan, images

    @property
    def generator(self) -> str:
        """The programs that make the file."""
        return f"mjrun {self.facts['mjrun']}, MuJoCo {self.facts['mujoco']}"

    @property
    def times(self) -> Sequence[float]:
        """The time of each frame in the file [s]: frame k is at k/fps."""
        return self.recorded_scene.schedule.times

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is shown, which may have a stage."""
        return self.recorded_scene.model

    @property
    def graph(self) -> SceneGraph:
        """All visible objects, with the added cameras as the last nodes."""
        return self._recorded[0]

    @property
    def motion(self) -> SceneMotion:
        """The motion of all nodes."""
        return self._recorded[1]

    def instants(self) -> Iterator[mujoco.MjData]:
        """Yields each frame with all derived fields, contacts and forces computed; to be read before the next."""
        return instants_of(self.context.model, iter(self.recorded_scene.states))

    def images(self) -> Generator[Sequence[np.ndarray]]:
        """Draws each frame, and yields the image `(height, width, 3)` uint8 of each requested camera, in order."""
        from mjrun.outputs.frame_drawing import FrameDrawer, frame_compositor

        assert self._images
        compositor = frame_compositor(self._images, self.recorded_scene)
        with closing(FrameDrawer(self._images, self.recorded_scene, compositor)) as drawing:
            for _ in self.times:
                yield drawing.draw()

    @cached_property
    def layers(self) -> Sequence[str]:
        """The requested layers that viewers of the format show in their own way."""
        options = visual_of(self.request).options()
        shown = {"labels": options.label == BODY_LABELS}
        shown |= {name: bool(options.flags[FLAGS[name]]) for name in CONTACTS}
        return [name for name in self.request.file_format.layers if shown[name]]

    @property
    def _options(self) -> mujoco.MjvOption:
        """The flags and groups of what the scene itself holds."""
        options = visual_of(self.request).options()
        for name in self.layers:
            if name == "labels":
                options.label = NO_LABELS
            else:
                options.flags[FLAGS[name]] = 0
        return options

    @cached_property
    def _recorded(self) -> tuple[SceneGraph, SceneMotion]:
        model, decorations = self.model, self.recorded_scene.decorations
        scene_request = SceneContentSettings(
            options=self._options,
            decorations=[(type(each).__name__.lower(), each.add) for each in decorations],
            room=sum(each.geoms for each in decorations),
            hidden=self.request.file_format.hidden,
            detail=DETAIL[self.request.quality],
        )
        states = (widened(model, state) for state in iter(self.recorded_scene.states))
        instants = instants_of(model, states) if scene_request.needs_forces(model) else _positions(model, states)
        graph, motion = record_scene(model, instants, self.times, scene_request)
        for text in [*graph.remarks, *self._unused()]:
            self.context.reporter.warn(text)
        return self._with_shots(graph, motion)

    def _unused(self) -> list[str]:
        """Returns a warning about flags that only change images, which no export shows."""
        names = [name for name in (*self.request.show, *self.request.hide) if name in enum_members(mujoco.mjtRndFlag)]
        if not names or self.request.renderer_options is not None:
            return []
        return [f"{listing(names)}: ignored, since they only affect images"]

    def _with_shots(self, graph: SceneGraph, motion: SceneMotion) -> tuple[SceneGraph, SceneMotion]:
        """Adds the cameras that are not the model's."""
        poses = self.recorded_scene.poses
        nodes, tracks, frames = [*graph.nodes], [*motion.tracks], np.arange(len(self.times))
        for index, camera in enumerate(self._plan.motions):
            positions = np.array([each[index].position for each in poses])
            quaternions = np.array([matrix_quaternion(each[index].rotation) for each in poses])
            tracks.append(Track(len(nodes), frames, positions, quaternions, np.ones((len(frames), 3)), smooth=True))
            nodes.append(
                Node(
                    name=clean(camera.script.name),
                    kind="shot",
                    id=index,
                    parent=0,
                    position=vector(positions[0]),
                    quaternion=quaternion(quaternions[0]),
                    moves=True,
                    lens=_lens(poses[0][index], self.request.size),
                )
            )
        return replace(graph, nodes=nodes), replace(motion, tracks=tracks)


@dataclass(frozen=True)
class ExportContent:
    """The planned content of an export.

    Attributes:
      images: the images that the file holds, if any.
      schedule: the schedule of the frames; None if events decide.
      table: the measured values, if any.
      rows: the steps of their rows; None for those of the frames.
      detector: detects marks on the time line, if any.
    """

    scene: ScenePlan
    images: "FramePlan | None"
    schedule: FrameSchedule | None
    table: ProbeSampler | None
    rows: Sequence[int] | None
    detector: EventAndAssertionDetector | None


class OpenExport(output.OpenOutput[ExportResult]):
    """An export with an open file."""

    def __init__(
        self, request: Export, content: ExportContent, stack: ExitStack, backends: output.RenderingResources
    ) -> None:
        self._request, self._content, self._context = request, content, content.scene.context
        self._facts = self._context.facts(request, content.schedule.observed if content.schedule else None)
        self._images: FrameRecorder | None = None
        if content.images:
            from mjrun.outputs.camera_panels import panel_files
            from mjrun.outputs.frame_drawing import open_frame_recorder

            files = panel_files(content.images.request, content.images.request.output)
            self._images = open_frame_recorder(content.images, content.schedule, files, stack, backends, request.jobs)
        self._states = self._images.states if self._images else open_states(content.scene, stack)
        self._rows = stack.enter_context(closing(SpooledRows(len(content.table.columns) if content.table else 0)))
        self._detector = content.detector
        self._contacts: ContactRecorder | None = None
        if request.file_format.contacts:
            self._contacts = stack.enter_context(closing(ContactRecorder(self._context.model)))
        destination = StandardOutput() if request.output == "-" else StagedFile(Path(request.output))
        self._writer = stack.enter_context(OutputWriter(destination))
        self._file: BinaryIO = self._writer.open_file()
        if content.schedule:
            self._observe(content.schedule)

    def choose_taps(self, event_steps: output.EventSteps) -> None:
        self._observe(self._request.schedule_frames(self._content.scene, event_steps))

    def _observe(self, schedule: FrameSchedule) -> None:
        """Makes the taps that record the frames of a schedule."""
        self._schedule, table = schedule, self._content.table
        self.taps = state_taps(self._content.scene, schedule, self._states)
        self._steps = schedule.steps if self._content.rows is None else self._content.rows
        if table:
            self._buffer = RowBuffer(table, self._steps, lambda block: self._rows.extend(block.values))
            self.taps.append(Tap(self._steps, self._buffer.record))
        if self._contacts:
            self.taps.append(Tap(schedule.steps, self._contacts.record))
        if self._detector:
            self.taps.append(self._detector.tap(self._context.timeline.steps))

    def finish(self, simulation_wall: float) -> output.FinishedOutput[ExportResult]:
        """Writes the scene, and draws its images as the format asks for them."""
        placed = place_scene(self._content.scene, self._schedule, self._states)
        marks, verdicts = self._detector.finish() if self._detector else ((), ())
        failed = [verdict.message for verdict in verdicts if not verdict.passed]
        contacts = self._contacts.contacts(len(placed.states)) if self._contacts else None
        values, plan = self._measured(), self._content.scene
        scene = SceneToExport(self._request, plan, placed, self._images, values, marks, contacts, self._facts)
        with self._writer.writing():
            resolve_name(self._request.file_format.write)(scene, self._file)
            self._file.flush()
            size = self._file.tell() if self._file.seekable() else 0
        self._writer.finish()

        request, timeline, count = self._request, self._context.timeline, len(placed.states)
        result = ExportResult(
            path=request.output,
            format=request.file_format.name,
            frames=count,
            fps=float(request.fps),
            duration=float(count / request.fps),
            simulated=float(timeline.duration),
            steps=timeline.steps,
            size=size,
            simulation_wall=simulation_wall,
            assertions=verdicts,
        )
        return output.FinishedOutput(result, [self._writer], {**self._facts, "frames": count}, failed)

    def _measured(self) -> MeasuredValues | None:
        table = self._content.table
        if table is None:
            return None
        self._buffer.flush()
        return MeasuredValues(table.columns, self._steps, self._rows)


def _positions(model: mujoco.MjModel, states: Iterable[np.ndarray]) -> Iterator[mujoco.MjData]:
    """Yields each state with positions computed, in one MjData for all."""
    data = mujoco.MjData(model)
    for state in states:
        restore(model, data, state)
        compute_poses(model, data)
        yield data


def _lens(pose: CameraPose, size: tuple[int, int]) -> CameraLens:
    seen, halfwidth = pose.frustum, pose.frustum.halfwidth(size)
    sides = seen.center - halfwidth, seen.center + halfwidth
    return camera_lens(sides, (seen.bottom, seen.top), (seen.near, seen.far), orthographic=seen.orthographic)


def write_glb_file(scene: SceneToExport, file: BinaryIO) -> None:
    """Writes the scene with its motion as binary glTF."""
    from mjrun.formats.glb import write_glb

    for text in write_glb(file, scene.graph, scene.motion, {"mjrun": scene.facts}, scene.generator):
        scene.context.reporter.warn(text)


def write_usd_file(scene: SceneToExport, file: BinaryIO) -> None:
    """Writes the scene with its motion as OpenUSD."""
    from mjrun.formats.usd import write_usd

    form, suffix = scene.request.file_format, Path(scene.request.output).suffix.lower()
    kind = suffix if suffix in form.suffixes else format_named(scene.request.format or form.name)[1]
    for text in write_usd(file, kind, scene.graph, scene.motion, float(scene.request.fps), scene.facts):
        scene.context.reporter.warn(text)
