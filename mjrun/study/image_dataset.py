"""A dataset: labelled images of many variations of a model, and the documents that readers of datasets need."""

import hashlib
import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import EmptyDatasetError, FailedPointsError, FileError, UsageError, listing, option
from mjrun.experiment.results_table import raise_failures
from mjrun.file_version import file_version
from mjrun.formats import datasets
from mjrun.formats.datasets import require_perspective
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.model.mujoco_globals import reported_warnings
from mjrun.model.names import names
from mjrun.model.override import Override
from mjrun.model.sources import source_of
from mjrun.options.datasets import CAMERA, EXTRAS, DatasetOptions, LabelledImageOptions
from mjrun.options.option import options, values_of
from mjrun.options.rendering import RIG_EXAMPLES, ViewOptions
from mjrun.options.sweep import MANIFEST, ExecutionOptions, VariationOptions
from mjrun.outputs.labelled_images import (
    AcceptanceConditions,
    LabelledImageRenderer,
    ObjectToLabel,
    labelled_objects,
    object_of_body,
)
from mjrun.outputs.recorded_scene import camera_motions
from mjrun.packages import require_all
from mjrun.rendering.backend import AUTO, GL
from mjrun.rendering.drawn_model import (
    HIDDEN_GROUP,
    VISIBLE_GROUPS,
    require_finite_extent,
    stage_parts,
    stage_remark,
    visible_geoms,
)
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.scene_graph.object_meshes import ObjectMesh, object_meshes
from mjrun.simulation.simulation import Simulation, require_simulation, require_whole
from mjrun.study.dataset_specs import RECORDS, ImageSpec, camera_argument, part_of, record_path
from mjrun.study.executors import WARP, check_engine
from mjrun.study.part_files import kept_results_in_errors
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import STATUSES, PointFailureGroup, point_failures, study_table
from mjrun.study.spec import PointResult
from mjrun.study.study import Study
from mjrun.version import __version__

SCHEMA = "mjrun-dataset-1"
OBJECTS = "objects.json"
LABELS = "labels/"  # of YOLO: files that exist for each image, and not for the dataset


@options
class Dataset(DatasetOptions, ExecutionOptions):
    """Labelled images of `simulation` with the values of each point. Its options are keywords.

    Args:
      command: command line, for the manifest.
    """

    simulation: Simulation = field(kw_only=False)
    command: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)
        require_whole(self.simulation, "images at given times")
        if "bop" in self.format and len(self.format) > 1:
            others = listing([name for name in self.format if name != "bop"])
            raise UsageError(f"{option('format')}: bop has other folders than {others}; write a dataset for each")
        if self.engine == WARP:
            raise UsageError(f"{option('engine')} warp renders nothing; {option('engine')} local does")

    def run(self, reporter: Reporter | None = None) -> "DatasetResult":
        """Renders the points that are missing, and writes the documents of all formats.

        Raises:
          FailedPointsError: points failed; everything else is written nevertheless.
          EmptyDatasetError: no image satisfies the conditions; everything else is written nevertheless.
          MjrunError: nothing could be rendered.
        """
        reporter, start = reporter or PythonApiReporter(), time.perf_counter()
        require_all({"dataset": EXTRAS["dataset"]})
        with reported_warnings(reporter):
            model = self.simulation.load()
            objects = labelled_objects(self, model)
            study = self._study(self._stage_parts(model, reporter))
            names = tuple(each.name for each in objects)
            spec = ImageSpec(self._labels(), self.split if "bop" in self.format else (), names, self._layout)
            prepared = PreparedStudy(study, replace(study.spec, product=spec))
            self._check(prepared, objects)
            check_engine(self.engine)
            study.compare_with_last_run(prepared, reporter, SCHEMA)
            prepared.files.create()
            prepared.warn(reporter)
            facts = {"points": len(prepared.keys), "schema": SCHEMA, "documents": self._documents()}
            study.write_manifest({**facts, **prepared.identities})
            prepared.known.forget(self._lost(prepared))
            missing = prepared.missing(self.retry_failed)
            prepared.note_known(missing, reporter)
            made = 0
            if missing:
                made = prepared.simulate(missing, study, reporter, publish=self._publish).total()
                prepared.known.forget(self._lost(prepared))  # such as those whose files have been removed meanwhile
            with kept_results_in_errors(prepared.folder, prepared.noun):
                return self._conclude(study, prepared, objects, made, start)

    @property
    def _layout(self) -> Any:
        return "bop" if "bop" in self.format else "flat"

    def _labels(self) -> LabelledImageOptions:
        """Returns the options of images; processes that simulate have a MUJOCO_GL that switches rendering off."""
        return LabelledImageOptions(
            **{**values_of(self, LabelledImageOptions), "gl": self.gl or os.environ.get(GL) or AUTO}
        )

    def _stage_parts(self, model: mujoco.MjModel, reporter: Reporter) -> Sequence[str]:
        """Returns the parts of a stage to add, and reports those that are not requested."""
        require_finite_extent(model, self.simulation.source)
        parts = stage_parts(ViewOptions(stage=self.stage), model, cameras=(), is_measured=True)
        if parts and "auto" in self.stage:
            reporter.note(stage_remark(parts))
        return parts

    def _study(self, stage: Sequence[str]) -> Study:
        """Returns the study of the points, whose model has these parts of a stage."""
        values = values_of(self, VariationOptions, ExecutionOptions)
        simulation = self.simulation
        if stage:
            source = source_of(simulation.model).with_overrides([Override("", part, "stage") for part in stage])
            simulation = replace(simulation, model=source)
        return Study(simulation, output=self.output, command=self.command, **values)

    def _check(self, prepared: PreparedStudy, objects: Sequence[ObjectToLabel]) -> None:
        """Raises errors that concern all points before the first is rendered."""
        AcceptanceConditions(self, objects)
        if self.engine == "local":
            LabelledImageRenderer(self._labels())  # other machines have their own renderers
        if self.yolo_task == "pose" and not any(each.keypoints for each in objects):
            raise UsageError(f"{option('yolo_task')} pose: no object has {option('keypoints')}")
        first = prepared.points.values(0)
        camera = {key.removeprefix(CAMERA): text for key, text in first.items() if key.startswith(CAMERA)}
        if camera and not any(isinstance(each, str) and each.partition(":")[0] in RIG_EXAMPLES for each in self.camera):
            raise UsageError(
                f"{option('vary')} {CAMERA}…: a camera of the model has no settings; give a rig, such as free"
            )
        cameras = [camera_argument(each, camera) if isinstance(each, str) else each for each in self.camera]
        for motion in camera_motions(cameras, self.size, prepared.model):
            for each in self.format:
                require_perspective(each, motion.script.name, perspective=motion.perspective)
        timeline = prepared.first.timeline(prepared.model)
        if self.simulation.has_end and max(self.times) > timeline.duration:
            late, end = float(max(self.times)), float(timeline.duration)
            raise UsageError(f"{option('times')}: {late:g} s is after the end of the simulation at {end:g} s")

    def _lost(self, prepared: PreparedStudy) -> list[int]:
        """Returns the points with results whose files are missing, changed or of another point."""
        lost = list[int]()
        for index, result in enumerate(prepared.known):
            if result.status == "ok" and not self._is_complete(index, prepared):
                lost.append(index)
        return lost

    def _is_complete(self, index: int, prepared: PreparedStudy) -> bool:
        document = self._record(index)
        written = file_version(str(Path(self.output) / record_path(index)))
        if document is None or written is None or document.get("key") != prepared.keys[index]:
            return False
        contents = document.get("contents", {})
        return all(self._is_same(path, contents.get(path), max(written[-2:])) for path in _paths(document))

    def _is_same(self, path: str, content: Mapping[str, object] | None, written: int) -> bool:
        """Returns whether a file has the content in a record of the time `written` [ns]; reads only later ones."""
        place = Path(self.output) / path
        version = file_version(str(place))
        if version is None or content is None:  # as in records of earlier versions
            return version is not None
        is_later = max(version[-2:]) > written
        return version[2] == content["bytes"] and (not is_later or _sha256(place.read_bytes()) == content["sha256"])

    def _has_other(self, index: int, prepared: PreparedStudy) -> bool:
        """Returns whether the folder has images of another point in place of this one."""
        document = self._record(index)
        return document is not None and document.get("key") != prepared.keys[index]

    def _documents(self) -> list[str]:
        """Returns the documents of formats that earlier runs have written in the folder."""
        try:
            manifest = json.loads((Path(self.output) / MANIFEST).read_text("utf-8"))
            return _inside(map(str, manifest["documents"]))
        except (OSError, ValueError, KeyError, TypeError):
            return []

    def _record(self, index: int) -> dict[str, Any] | None:
        """Returns the record of a point; None if it is missing or unreadable."""
        try:
            document = json.loads((Path(self.output) / record_path(index)).read_text("utf-8"))
        except (OSError, ValueError):
            return None
        return document if isinstance(document, dict) else None

    def _publish(self, key: str, result: PointResult) -> None:
        """Writes the files of a point, the record with its key last; removes those of an earlier point.

        If they replace images of another point, the documents that describe these are removed first.
        """
        if not result.files:
            return
        record = self._record(result.index)
        if record is not None and record.get("key") != key:
            self._remove(self._documents())
        before = _paths(record)
        *images, (path, content) = result.files
        self._remove(_labels(before))
        contents = {path: {"bytes": len(image), "sha256": _sha256(image)} for path, image in images}
        head = json.dumps({"key": key, "contents": contents})[:-1]
        self._write([*images, (path, b"%s, %s" % (head.encode(), content[1:]))])
        self._remove({*before} - {path for path, _ in images})

    def _write(self, files: datasets.Files) -> None:
        for path, content in files:
            place = Path(self.output) / path
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise FileError(place.parent, f"cannot be made: {error.strerror}") from None
            with written_file(place, content) as output:
                output.publish()

    def _remove(self, paths: Iterable[str]) -> None:
        """Removes files that are not part of the dataset any more."""
        for path in paths:
            (Path(self.output) / path).unlink(missing_ok=True)

    def _remove_other_points(self, prepared: PreparedStudy) -> None:
        """Removes the images and records of points that the dataset does not have, or whose last attempt failed."""
        results = prepared.known
        is_failed = ~(results.is_missing | (results.status == STATUSES.index("ok")))
        for place in sorted((Path(self.output) / RECORDS).glob("*.json")):
            if not place.stem.isdecimal():
                continue
            index = int(place.stem)
            if index >= len(results) or is_failed[index] or self._has_other(index, prepared):
                images = _paths(self._record(index))
                self._remove([*images, *_labels(images)])
                place.unlink(missing_ok=True)

    def _conclude(
        self,
        study: Study,
        prepared: PreparedStudy,
        objects: Sequence[ObjectToLabel],
        made: int,
        start: float,
    ) -> "DatasetResult":
        """Writes the labels and returns the result."""
        results, folder = prepared.known, Path(self.output)
        facts = {"mjrun": __version__, "mujoco": mujoco.mj_versionString()}
        study_table(prepared.points, (), results, prepared.units).write(folder, facts)
        self._remove_other_points(prepared)
        parts: dict[str, list[Mapping[str, Any]]] = {name: [] for name, share in self.split if share}
        rejected, earlier = 0, {*self._documents()}
        for index, result in enumerate(results):
            document = self._record(index) if result.status == "ok" else None
            for image in document["images"] if document else ():
                rejected += not image["accepted"]
                if image["accepted"]:
                    parts[part_of(index, self.split)].append(image)

        sites = names(prepared.model, "site")
        described = [(each.name, each.category, tuple(sites[i] for i in each.keypoints)) for each in objects]
        meshes = self._meshes(prepared, objects) if "bop" in self.format else ()
        dataset = datasets.DatasetRecords(parts, described, self.polygons, self.yolo_task, meshes)
        self._write([(OBJECTS, self._objects(objects, prepared.model))])
        documents = list[str]()
        for name in self.format:
            if name != "folder":
                files = import_module(f"mjrun.formats.datasets.{name}").files(dataset)
                self._write(files)
                documents += [path for path, _ in files if not path.startswith(LABELS)]
        if "yolo" not in self.format:
            earlier.update(_labels(path for images in parts.values() for path in _paths({"images": images})))
        self._remove(earlier.difference(documents))
        result = DatasetResult(
            path=str(folder),
            points=len(results),
            rendered=made,
            images={part: len(images) for part, images in parts.items()},
            rejected=rejected,
            objects=[each.name for each in objects],
            categories=dataset.categories,
            statuses=results.counts,
            failures=point_failures(prepared.points, results),
            wall=time.perf_counter() - start,
        )
        facts = {"schema": SCHEMA, "format": list(self.format), "images": dict(result.images), "documents": documents}
        study.write_manifest({**facts, **prepared.identities})
        if results.counts.get("ok", 0) < len(results):
            raise_failures(result, [], FailedPointsError(results.counts))
        if not any(result.images.values()):
            raise_failures(result, [], EmptyDatasetError(rejected, str(folder / RECORDS)))
        return result

    def _meshes(self, prepared: PreparedStudy, objects: Sequence[ObjectToLabel]) -> Sequence[ObjectMesh | None]:
        """Returns the meshes of the objects at the start of the first point."""
        stepper = prepared.first.stepper(prepared.first.load())
        model, data = stepper.model, stepper.initial()
        model.geom_group[:] = np.where(visible_geoms(model, self.geoms), VISIBLE_GROUPS[0], HIDDEN_GROUP)
        roots = [each.body for each in objects]
        return object_meshes(model, data, roots, object_of_body(model, roots))

    def _objects(self, objects: Sequence[ObjectToLabel], model: mujoco.MjModel) -> bytes:
        """Returns the list of objects, and of the bodies that part masks distinguish."""
        sites = names(model, "site")
        listed = [
            {
                "id": number,
                "name": each.name,
                "category": each.category,
                "keypoints": [sites[site] for site in each.keypoints],
            }
            for number, each in enumerate(objects, 1)
        ]
        bodies = [{"id": number, "name": name} for number, name in enumerate(names(model, "body"), 1)]
        return f"{json.dumps({'objects': listed, 'parts': bodies}, indent=1)}\n".encode()


def _paths(record: Mapping[str, Any] | None) -> list[str]:
    """Returns the files of the images of a point, inside of the folder."""
    return _inside(str(path) for image in (record or {}).get("images", ()) for path in image["files"].values())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _inside(paths: Iterable[str]) -> list[str]:
    return [path for path in paths if not Path(path).is_absolute() and ".." not in Path(path).parts]


def _labels(images: Iterable[str]) -> set[str]:
    """Returns the files that may have the labels of images in YOLO's format."""
    return {f"{LABELS}{Path(path).stem}.txt" for path in images}


@dataclass(frozen=True)
class DatasetResult:
    """The result of a dataset.

    Attributes:
      path: folder of the dataset.
      points: number of points.
      rendered: number of points that were rendered now; the others were known.
      images: number of accepted images by part of the dataset.
      rejected: number of images that do not satisfy the conditions.
      objects: names of the objects.
      categories: names of the categories.
      statuses: number of points by status.
      failures: reasons of failures, with the number of points and the first of them.
      wall: wall time [s].
      schema: name of this schema.
    """

    path: str
    points: int
    rendered: int
    images: Mapping[str, int]
    rejected: int
    objects: Sequence[str]
    categories: Sequence[str]
    statuses: Mapping[str, int]
    failures: Sequence[PointFailureGroup]
    wall: float
    schema: str = SCHEMA
