"""Labelled images of the points of a dataset: files and records, as bytes that any machine can send."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UsageError, listing
from mjrun.formats.image_encoding import ImageData, png
from mjrun.model.variants import VariantLoader
from mjrun.options.datasets import CAMERA
from mjrun.outputs.labelled_images import LabelledImage, LabelledImageRenderer, ObjectAnnotation, labelled_objects
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.simulation.simulation import Simulation
from mjrun.study.dataset_specs import ImageSpec, camera_argument, part_of, record_path


class PointImageMaker:
    """A maker of the images of points, in the process that simulates them."""

    def __init__(self, spec: ImageSpec) -> None:
        self._spec = spec
        self._variants = VariantLoader()
        os.environ.setdefault("LP_NUM_THREADS", "1")  # of llvmpipe: the other cores have processes, too
        self._renderer = LabelledImageRenderer(spec.options, outlines=spec.layout == "bop")

    def make(
        self, index: int, values: Mapping[str, str], simulation: Simulation
    ) -> tuple[int, tuple[tuple[str, bytes], ...]]:
        """Simulates a point, and returns the number of its steps, and its files by their paths, the record last.

        Args:
          index: number of the point.
          values: its parameters.

        Raises:
          SimulationError: the simulation became unstable.
          UsageError: a camera or an object is unknown.
          DrawError: OpenGL failed.
        """
        options = self._spec.options
        variant = None if simulation.episode else self._variants.load(simulation.source)
        model = variant.model if variant else simulation.load()
        timeline = simulation.timeline(model)
        steps = sorted({round(time / timeline.timestep) for time in options.times})
        states = list[np.ndarray]()
        stepper = simulation.stepper(model)
        run_with_taps(stepper, [Tap(steps, lambda stepper: states.append(stepper.state().copy()))], steps[-1])
        camera = {key.removeprefix(CAMERA): text for key, text in values.items() if key.startswith(CAMERA)}
        cameras = [camera_argument(each, camera) if isinstance(each, str) else each for each in options.camera]
        times = [float(timeline.time(step)) for step in steps]

        files, images = list[tuple[str, bytes]](), list[dict[str, Any]]()
        part = part_of(index, self._spec.split) if self._spec.split else ""
        first = index * self._spec.per_point
        for number, image in enumerate(self._images(stepper.model, cameras, states, times), first):
            paths = dict[str, str]()
            if image.is_accepted:
                contents = {kind: (path, data) for kind, path, data in self._contents(part, number, image)}
                files += contents.values()
                paths = {kind: path for kind, (path, _) in contents.items()}
            images.append(record(number, image, paths))
        document = {"point": index, "values": dict(values), "images": images}
        if variant:
            self._variants.reuse(variant)
        return steps[-1], (*files, (record_path(index), f"{json.dumps(document, allow_nan=False)}\n".encode()))

    def _images(
        self, model: mujoco.MjModel, cameras: Sequence[object], states: Sequence[np.ndarray], times: Sequence[float]
    ) -> Iterator[LabelledImage]:
        names, expected = [each.name for each in labelled_objects(self._spec.options, model)], self._spec.objects
        if tuple(names) != expected:
            raise UsageError(f"the model has other objects, {listing(names)}, than the first, {listing(expected)}")
        yield from self._renderer.images(model, cameras, states, times)

    def _contents(self, part: str, number: int, image: LabelledImage) -> Iterator[tuple[str, str, bytes]]:
        """Yields kind, path and content of each file of an image."""
        pixels = {"rgb": image.rgb, "depth": image.depth}
        if self._spec.layout == "flat":
            is_small = len(image.views) <= np.iinfo(np.uint8).max
            masks = (image.objects + 1).astype(np.uint8) if is_small else image.objects
            pixels |= {"masks": masks, "parts": image.bodies}
            for kind, values in pixels.items():
                folder = {"rgb": "images", "parts": "part_masks"}.get(kind, kind)
                yield kind, f"{folder}/{number:06d}.png", _png(values)
            return
        folder = f"{part}/000000"
        for kind, values in pixels.items():
            yield kind, f"{folder}/{kind}/{number:06d}.png", _png(values)
        for index, view in enumerate(image.views):
            name = f"{number:06d}_{index:06d}.png"
            assert view.alone is not None
            yield f"mask/{index}", f"{folder}/mask/{name}", _png(view.alone.astype(np.uint8) * 255)
            visible = (image.objects == index).astype(np.uint8) * 255
            yield f"mask_visib/{index}", f"{folder}/mask_visib/{name}", _png(visible)


def record(number: int, image: LabelledImage, files: Mapping[str, str]) -> dict[str, Any]:
    """Returns the labels of an image as plain values.

    Pixels are counted from the corner of the image: the centre of the first one is (0.5, 0.5). Lengths are in metres,
    cameras and poses in the axes of OpenCV.
    """
    camera = image.calibration
    return {
        "id": number,
        "accepted": image.is_accepted,
        "files": dict(files),
        "camera": image.camera,
        "time": image.time,
        "size": list(camera.size),
        "K": camera.matrix.tolist(),
        "world_from_camera": camera.pose.tolist(),
        "near": camera.near,
        "far": camera.far,
        "perspective": camera.perspective,
        "objects": [_object(index, view) for index, view in enumerate(image.views)],
    }


def _object(index: int, view: ObjectAnnotation) -> dict[str, Any]:
    region = view.region
    return {
        "id": index + 1,
        "name": view.object.name,
        "category": view.object.category,
        "pixels": view.pixels,
        "silhouette": round(view.silhouette, 3),
        "visible": view.visible,
        "truncated": view.truncated,
        "bbox": list(region.bbox) if region else None,
        "outline": list(view.outline),
        "counts": region.counts if region else None,
        "camera_from_object": view.pose.tolist(),
        "box": {"center": view.box.center.tolist(), "size": view.box.size.tolist()},
        "keypoints": view.keypoints.tolist(),
    }


def _png(pixels: np.ndarray) -> bytes:
    return png(ImageData(pixels, int(pixels.max()) + 1 if pixels.dtype == np.int32 else 0, None, {}))
