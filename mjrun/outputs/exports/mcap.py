"""The messages of an MCAP export: each part of a simulation on its own topic, at simulated times.

The world is the frame `world`, a body the frame of its name, and a camera the frame `camera/NAME`.
"""

import heapq
import itertools
import json
import re
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from io import BytesIO
from operator import itemgetter
from typing import BinaryIO

import mujoco
import numpy as np

from mjrun.camera.pose import lens
from mjrun.errors import clean
from mjrun.formats import mcap
from mjrun.formats.ffmpeg import H264Encoder
from mjrun.formats.glb import write_glb
from mjrun.formats.image_encoding import ImageData, jpeg, png
from mjrun.formats.mcap import McapWriter, NumericMessages, TableMessages, groups
from mjrun.model.camera_images import CameraCalibration
from mjrun.model.names import BALL, FREE, PLACES, distinct, names, object_names
from mjrun.options.export import H264
from mjrun.outputs.export import Export, SceneToExport
from mjrun.probe.contacts import RecordedContacts, contact_columns, contact_rows
from mjrun.rendering.visual import visual_of
from mjrun.scene_graph.graph import Node, SceneGraph
from mjrun.scene_graph.meshes import SoftShapes
from mjrun.scene_graph.walk import matrix_quaternion
from mjrun.timeline import nanoseconds

WORLD = "world"
ENCODERS = {"jpeg": jpeg, "png": png}
RIGID = (*PLACES,)  # nodes that are part of a model; a body is of the stage
SHORTEST = 1e-6  # length of an arrow [m]
CONTACT = 2  # columns of a contact table before those of the contact: the time and the index

# The time of a message [ns], its channel and its content.
TimedMessage = tuple[int, int, bytes]


def write_mcap(scene: SceneToExport, file: BinaryIO) -> None:
    """Writes the messages of a simulation in the order of their times."""
    log = McapWriter(file, texts(scene.facts))
    model = scene.context.model
    cameras = topic_names(cameras_of(scene))
    frames = frame_names(model, cameras)
    of_cameras = frames[model.nbody :]
    models = mcap.scene(0, body_models(scene.graph, frames[: model.nbody], scene.generator))
    log.write(log.add_channel("/scene", mcap.SCENE), 0, models)
    sources = [
        instants(scene, InstantTopics(log, scene, frames)),
        rows(scene, log),
        images(scene, [CameraTopics(log, scene, *each) for each in zip(cameras, of_cameras, strict=True)]),
    ]
    with ExitStack() as stack:
        for source in sources:
            stack.enter_context(closing(source))
        for time, channel, message in heapq.merge(*sources, key=itemgetter(0)):
            log.write(channel, time, message)
    log.finish()


def texts(facts: Mapping[str, object]) -> dict[str, str]:
    """Returns facts as texts: JSON, except those that are texts."""
    return {name: fact if isinstance(fact, str) else json.dumps(fact, default=str) for name, fact in facts.items()}


def cameras_of(scene: SceneToExport) -> list[str]:
    """Returns the names of the cameras whose images are exported."""
    return [node.name for node in scene.graph.nodes if node.kind == "shot"]


def topic_names(cameras: Sequence[str]) -> list[str]:
    """Returns the part of the topics of each camera, of letters, digits, `_` and `-`."""
    rigs = (name.partition(":")[0] for name in cameras)  # `orbit` of `orbit:azimuth=90`
    words = (re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") or "camera" for name in rigs)
    return list(distinct(words))


def frame_names(model: mujoco.MjModel, cameras: Sequence[str]) -> list[str]:
    """Returns the name of the frame of each body, the world first, and of each camera."""
    bodies = (clean(name) for name in names(model, "body")[1:])
    return list(distinct([WORLD, *bodies, *(f"camera/{name}" for name in cameras)]))


def body_models(graph: SceneGraph, frames: Sequence[str], generator: str) -> dict[str, bytes]:
    """Returns a GLB of the visible objects of each body, by the body's frame.

    Args:
      frames: the frames of the bodies of the model; the objects of other bodies are those of the world.
    """
    parts: dict[int, list[Node]] = {}
    owners: list[int] = []
    places: list[int] = []  # of each node in its part
    for index, node in enumerate(graph.nodes):
        if node.kind == "world" or (node.kind == "body" and node.id < len(frames)):
            owners.append(index)
            parts[index] = [Node(node.name, "world", node.id, -1)]
        elif node.moves or node.skin is not None or node.kind == "flex":  # without a fixed place on a body
            owners.append(owners[0])
        else:
            owners.append(owners[node.parent])
            if node.kind in RIGID:
                parts[owners[-1]].append(replace(node, parent=places[node.parent]))
        places.append(len(parts[owners[-1]]) - 1)

    models: dict[str, bytes] = {}
    for nodes in parts.values():
        if any(node.mesh is not None for node in nodes):
            file = BytesIO()
            write_glb(file, SceneGraph(nodes), generator=generator)
            models[frames[nodes[0].id]] = file.getvalue()
    return models


def instants(scene: SceneToExport, channels: "InstantTopics") -> Generator[TimedMessage]:
    """Yields the poses, joints and contacts of each frame."""
    poses = scene.recorded_scene.poses if cameras_of(scene) else itertools.repeat(())
    for time, data, cameras in zip(frame_times(scene), scene.instants(), poses, strict=False):
        yield from channels.messages(time, data, [lens(pose, scene.request.size) for pose in cameras])


def rows(scene: SceneToExport, log: McapWriter) -> Generator[TimedMessage]:
    """Yields the measured values of each row."""
    if scene.values is None:
        return
    columns = scene.values.columns
    channels = list[tuple[int, NumericMessages, list[int]]]()
    for group, indices in groups(columns[1:]).items():  # without the time, which each message has
        indices = [index + 1 for index in indices]
        encoder = NumericMessages(group, [columns[index] for index in indices])
        channels.append((log.add_channel(f"/trace/{group}", encoder.schema, encoder.metadata), encoder, indices))
    timeline = scene.context.timeline
    for steps, values in scene.values.blocks():
        contents = [(channel, encoder.encode(values[:, indices])) for channel, encoder, indices in channels]
        for row, step in enumerate(steps):
            time = nanoseconds(timeline.time(step))
            yield from ((time, channel, content[row]) for channel, content in contents)


def images(scene: SceneToExport, cameras: Sequence["CameraTopics"]) -> Generator[TimedMessage]:
    """Yields the image and the calibration of each camera for each frame."""
    if not cameras:
        return
    times = frame_times(scene)
    with ExitStack() as stack:
        drawn = stack.enter_context(closing(scene.images()))
        encoders = [stack.enter_context(closing(image_encoder(scene.request))) for _ in cameras]
        waiting = [deque[bytes]() for _ in cameras]
        encoded = 0
        for pixels in itertools.chain(drawn, [None]):
            for index, (encoder, queue) in enumerate(zip(encoders, waiting, strict=True)):
                queue += encoder.end() if pixels is None else encoder.write(pixels[index])
            while all(waiting):
                time, poses = next(times), scene.recorded_scene.poses[encoded]
                for camera, pose, queue in zip(cameras, poses, waiting, strict=True):
                    yield from camera.messages(time, queue.popleft(), lens(pose, scene.request.size))
                encoded += 1


def frame_times(scene: SceneToExport) -> Generator[int]:
    """Yields the simulated time of each frame [ns]."""
    for step in scene.recorded_scene.schedule.steps:
        yield nanoseconds(scene.context.timeline.time(step))


class InstantTopics:
    """The topics of an instant: poses of bodies and cameras, objects that change shape, joints, and contacts.

    Args:
      frames: the frames of all bodies, the world first, and of the cameras.
    """

    def __init__(self, log: McapWriter, scene: SceneToExport, frames: Sequence[str]) -> None:
        self._model = model = scene.context.model
        self._poses = log.add_channel("/tf", mcap.TRANSFORMS)
        self._transforms = mcap.TransformMessages(WORLD, frames[1:])
        joints = [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) not in (FREE, BALL)]
        self._qpos, self._dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._states = mcap.JointMessages([clean(name) for name in object_names(model, "joint", joints)])
        self._joints = log.add_channel("/joint_states", mcap.JOINTS) if joints else None
        self._soft = self._shapes = None
        if SoftShapes.exist_in(model):
            self._soft = SoftShapes(model, visual_of(scene.request).options())
            self._shapes = log.add_channel("/scene/shapes", mcap.SCENE)
        self._contacts = log.add_channel("/contacts", mcap.SCENE)
        self._rows = TableMessages("contacts", contact_columns(model)[CONTACT:])
        self._table = log.add_channel("/contacts/table", self._rows.schema, self._rows.metadata)
        # As MuJoCo draws them, except that a force without a scale has no arrow.
        mass = model.stat.meanmass
        self._length = model.vis.map.force / mass if mass > 0 else 0.0
        width = model.vis.scale.forcewidth * model.stat.meansize
        self._style = mcap.ArrowStyle(2 * width, model.vis.rgba.contactforce.tolist())

    def messages(self, time: int, data: mujoco.MjData, cameras: Sequence[CameraCalibration]) -> Generator[TimedMessage]:
        """Yields the messages of an instant.

        Args:
          time: its time [ns].
          data: the model at that time, with all derived fields computed.
        """
        positions = [data.xpos[1:], *(camera.pose[None, :3, 3] for camera in cameras)]
        turns = [data.xquat[1:], *(matrix_quaternion(camera.pose[:3, :3])[None] for camera in cameras)]
        yield time, self._poses, self._transforms.encode(time, np.concatenate(positions), np.concatenate(turns))
        if self._soft is not None and self._shapes is not None:
            yield time, self._shapes, mcap.shapes(time, WORLD, "shapes", self._soft.at(data))
        if self._joints is not None:
            rates = (field[self._dofs] for field in (data.qvel, data.qacc, data.qfrc_actuator))
            yield time, self._joints, self._states.encode(time, data.qpos[self._qpos], *rates)
        contacts = RecordedContacts.of(self._model, data)
        yield time, self._contacts, self._arrows(time, contacts)
        yield time, self._table, self._rows.encode(contact_rows(contacts, np.zeros(1))[:, CONTACT:])

    def _arrows(self, time: int, contacts: RecordedContacts) -> bytes:
        """Returns the force that acts on the second object of each contact."""
        forces = (contacts.wrenches[:, None, :3] @ contacts.contact_frames)[:, 0]
        vectors = self._length * forces
        visible = np.linalg.norm(vectors, axis=1) > SHORTEST
        starts = contacts.fields["pos"][visible]
        return mcap.arrows(time, WORLD, "contacts", starts, vectors[visible], self._style)


class CameraTopics:
    """The topics of a camera: its images, and its calibration unless it is orthographic."""

    def __init__(self, log: McapWriter, scene: SceneToExport, name: str, frame: str) -> None:
        self._frame = frame
        self._encoding, self._size = scene.request.images or H264, image_size(scene.request)
        if self._encoding == H264:
            self._images = log.add_channel(f"/camera/{name}/video", mcap.VIDEO)
        else:
            self._images = log.add_channel(f"/camera/{name}/image", mcap.IMAGE)
        self._calibrations = log.add_channel(f"/camera/{name}/calibration", mcap.CALIBRATION)

    def messages(self, time: int, content: bytes, seen: CameraCalibration) -> Generator[TimedMessage]:
        """Yields the messages of a frame: `content` is its encoded image."""
        if self._encoding == H264:
            yield time, self._images, mcap.video_frame(time, self._frame, content)
        else:
            yield time, self._images, mcap.image(time, self._frame, content, self._encoding)
        if seen.perspective:
            yield time, self._calibrations, mcap.calibration(time, self._frame, seen, self._size)


class StillImageEncoder:
    """An encoder of separate images, with the interface of `H264Encoder`. To be closed."""

    def __init__(self, encode: Callable[[ImageData], bytes]) -> None:
        self._encode = encode

    def write(self, frame: np.ndarray) -> list[bytes]:
        """Returns the encoded image."""
        return [self._encode(ImageData(frame, 0, None, {}))]

    def end(self) -> list[bytes]:
        """Returns nothing: no image waits."""
        return []

    def close(self) -> None:
        """Does nothing."""


def image_encoder(request: Export) -> H264Encoder | StillImageEncoder:
    """Returns an encoder of the images of one camera."""
    encode = ENCODERS.get(request.images or H264)
    return StillImageEncoder(encode) if encode else H264Encoder(request.size, request.fps)


def image_size(request: Export) -> tuple[int, int]:
    """Returns the size of encoded images [pixels]."""
    width, height = request.size
    return request.size if request.images in ENCODERS else (width + width % 2, height + height % 2)
