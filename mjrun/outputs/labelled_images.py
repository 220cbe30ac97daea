"""Labelled images: colours, depth and masks of an instant, and a record of the objects in view."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from enum import IntEnum

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, Frustum
from mjrun.camera.script import CameraScript, parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, concerning, option
from mjrun.formats.segmentation_labels import SegmentMask, regions
from mjrun.model.additions import FLOOR, GROUND, LIGHT
from mjrun.model.camera_images import CameraCalibration, CameraImages
from mjrun.model.fields import carriers, flex_owners, skin_owners
from mjrun.model.names import matching, names
from mjrun.options.datasets import LabelledImageOptions
from mjrun.options.rendering import ViewOptions
from mjrun.probe.row_expression import Condition, parse_condition
from mjrun.probe.scanner import Vocabulary
from mjrun.rendering.backend import BackendDetector
from mjrun.rendering.classic import ClassicRenderer, check_size
from mjrun.rendering.drawn_model import CORNERS, HIDDEN_GROUP, VISIBLE_GROUPS, place_stage, visible_geoms
from mjrun.rendering.visual import NOTHING, SegmentationIds, visual_of

GROUPED = ("geom", "site", "tendon", "flex", "skin")  # what is visible by groups
WIDEST = 8.0  # size of the view, relative to the image, in which the truncated part of an object is counted
APART = 2.0  # [pixels] around an object, for the radius of flexes and the rounding of edges
EVERYWHERE = np.array([-np.inf, -np.inf, np.inf, np.inf])
IN_VIEW = "objects"


@dataclass(frozen=True)
class ObjectBox:
    """A box in the frame of an object.

    Attributes:
      center: `(3,)` [m].
      size: its whole sides `(3,)` [m].
    """

    center: np.ndarray
    size: np.ndarray

    def corners(self, pose: np.ndarray) -> np.ndarray:
        """Returns its corners `(8, 3)` [m], moved by `pose` `(4, 4)`."""
        points = self.center + CORNERS * self.size / 2
        moved: np.ndarray = points @ pose[:3, :3].T + pose[:3, 3]
        return moved


@dataclass(frozen=True)
class ObjectToLabel:
    """An object that images are labelled with: a body with everything attached to it, or a flex.

    Attributes:
      category: the name of its kind.
      keypoints: the ids of its sites that are keypoints.
    """

    name: str
    category: str
    body: int
    keypoints: tuple[int, ...] = ()


def labelled_objects(options: LabelledImageOptions, model: mujoco.MjModel) -> list[ObjectToLabel]:
    """Returns the objects that `options` name; by default, all children of the world that have geoms, and flexes.

    Raises:
      UnknownNameError: a body or a site is unknown.
      UsageError: an object is part of another one, or the model has no bodies to label.
    """
    bodies, roots = names(model, "body"), model.body_rootid
    solid = {0, *roots[model.geom_bodyid].tolist()}
    flexes = dict[int, int]()  # the bodies that only carry a flex → that of the object
    for flex, (name, owner) in enumerate(zip(names(model, "flex"), roots[flex_owners(model)].tolist(), strict=True)):
        if owner not in solid:
            flexes |= dict.fromkeys({*roots[carriers(model, flex)].tolist()} - solid, owner)
            bodies[owner] = bodies[owner] if name in bodies else name
    chosen: dict[int, str] = {}
    for index, text in enumerate(options.objects):
        pattern, _, category = text.partition("=")
        with concerning("objects", index):
            for place in [bodies.index(pattern)] if pattern in bodies else matching(model, "body", pattern):
                body = flexes.get(place, place)
                if body == 0:
                    raise UsageError(f"{option('objects')}: the world is not an object")
                chosen.setdefault(body, category or bodies[body])
    if not options.objects:
        shown = sorted({*solid, *flexes.values()} - {0})
        chosen = {body: bodies[body] for body in shown if bodies[body] not in (FLOOR, GROUND)}
    if not chosen:
        raise UsageError(f"{option('objects')}: the model has no bodies to label")
    for body in chosen:
        if above := next((parent for parent in _ancestors(model, body) if parent in chosen), None):
            raise UsageError(f"{option('objects')}: {clean(bodies[body])} is part of {clean(bodies[above])}")

    owner = object_of_body(model, list(chosen))
    points: dict[int, list[int]] = {body: [] for body in chosen}
    for index, pattern in enumerate(options.keypoints):
        with concerning("keypoints", index):
            for site in matching(model, "site", pattern):
                place = owner[model.site_bodyid[site]]
                if place >= 0 and site not in points[[*chosen][place]]:
                    points[[*chosen][place]].append(site)
    return [ObjectToLabel(bodies[body], name, body, tuple(points[body])) for body, name in chosen.items()]


def object_of_body(model: mujoco.MjModel, roots: Sequence[int]) -> np.ndarray:
    """Returns the index of the object that each body belongs to `(nbody,)`, −1 for none; `roots` are their bodies."""
    owners = np.full(model.nbody, -1, np.int32)
    for body in range(1, model.nbody):  # parents come first
        owners[body] = roots.index(body) if body in roots else owners[model.body_parentid[body]]
    return owners


@dataclass(frozen=True)
class ObjectAnnotation:
    """An object as an image shows it.

    Attributes:
      region: its visible pixels; None if it is not visible.
      pixels: number of visible pixels.
      silhouette: number of pixels that it would have alone, including those outside of the image.
      truncated: share of its silhouette outside of the image.
      outline: x, y, width and height of the box around its silhouette [pixels], which may exceed the image.
      alone: its silhouette within the image `(h, w)` bool, if requested.
      pose: `(4, 4)`, camera from object, in the axes of OpenCV [m].
      box: the box around it in its frame.
      keypoints: `(n, 3)`: x and y [pixels], and 2 if visible, 1 if covered, 0 if outside of the image.
    """

    object: ObjectToLabel
    region: SegmentMask | None
    pixels: int
    silhouette: float
    truncated: float
    outline: tuple[float, float, float, float]
    alone: np.ndarray | None
    pose: np.ndarray
    box: ObjectBox
    keypoints: np.ndarray

    @property
    def visible(self) -> float:
        """The share of the silhouette that is visible."""
        return self.pixels / self.silhouette if self.silhouette else 0.0


@dataclass(frozen=True)
class LabelledImage:
    """An image and its labels.

    Attributes:
      time: simulated time [s].
      calibration: calibration of the camera.
      rgb: `(h, w, 3)` uint8.
      depth: `(h, w)` float32 [m], infinite for the background.
      objects: `(h, w)` int32, indices into the objects, −1 for none.
      bodies: `(h, w)` int32, ids of bodies, −1 for none.
      views: the objects, visible or not.
      is_accepted: whether all conditions hold.
    """

    camera: str
    time: float
    calibration: CameraCalibration
    rgb: np.ndarray
    depth: np.ndarray
    objects: np.ndarray
    bodies: np.ndarray
    views: Sequence[ObjectAnnotation]
    is_accepted: bool


class AcceptanceConditions:
    """The conditions that an image must satisfy.

    Raises:
      UsageError: a condition is invalid.
    """

    def __init__(self, options: LabelledImageOptions, objects: Sequence[ObjectToLabel]) -> None:
        columns = [f"{name}/{each.name}" for name in ("pixels", "visible", "truncated") for each in objects]
        self._conditions = list[Condition]()
        for index, text in enumerate(options.accept):
            with concerning("accept", index):
                self._conditions.append(parse_condition(text, Vocabulary([*columns, IN_VIEW]), option("accept")))

    def hold(self, views: Sequence[ObjectAnnotation]) -> bool:
        """Returns whether all conditions hold for an image of these objects."""
        values = {IN_VIEW: float(sum(view.pixels > 0 for view in views))}
        for view in views:
            name = view.object.name
            values |= {f"pixels/{name}": view.pixels, f"visible/{name}": view.visible}
            values[f"truncated/{name}"] = view.truncated
        columns = {name: np.array([value], float) for name, value in values.items()}
        return all(bool(np.all(condition.holds(columns))) for condition in self._conditions)


class LabelledImageRenderer:
    """A renderer of labelled images of many similar models. To be used in one thread, and closed.

    Args:
      outlines: whether images need the silhouette of each object.

    Raises:
      RendererError: no backend works.
      UsageError: the renderer does not support images of this size.
    """

    def __init__(self, options: LabelledImageOptions, *, outlines: bool = False) -> None:
        self._options, self._outlines = options, outlines
        detection = BackendDetector(options.gl)
        self._backend = detection.result(require_gpu=options.require_gpu)
        self._visual = visual_of(ViewOptions(quality=options.quality, gl=options.gl, camera="free"))
        check_size(options.size, self._backend, self._visual)
        self._renderer: ClassicRenderer | None = None

    def images(
        self, model: mujoco.MjModel, cameras: Sequence[object], states: Sequence[np.ndarray], times: Sequence[float]
    ) -> Iterator[LabelledImage]:
        """Yields the images of each state, one of each camera.

        Args:
          model: the model; its groups of geoms change until the last image, and a stage in it is placed.
          cameras: cameras or camera scripts, as on the command line.
          times: simulated times of the states [s], ascending.

        Raises:
          UsageError: a camera or an object is unknown.
          DrawError: OpenGL failed.
        """
        poses = [self._poses(model, camera, index, states, times) for index, camera in enumerate(cameras)]
        visible, groups = visible_geoms(model, self._options.geoms), model.geom_group.copy()
        stage = ((mujoco.mjtObj.mjOBJ_LIGHT, LIGHT), (mujoco.mjtObj.mjOBJ_GEOM, FLOOR))
        if any(mujoco.mj_name2id(model, kind, name) >= 0 for kind, name in stage):
            place_stage(model, states)
        model.geom_group[:] = np.where(visible, VISIBLE_GROUPS[0], HIDDEN_GROUP)
        try:
            yield from self._rendered(model, visible, cameras, poses, states, times)
        finally:
            model.geom_group[:] = groups

    def _poses(
        self,
        model: mujoco.MjModel,
        camera: object,
        index: int,
        states: Sequence[np.ndarray],
        times: Sequence[float],
    ) -> list[CameraPose]:
        """Returns the pose of a camera in each state."""
        with concerning("camera", index):
            script = camera if isinstance(camera, CameraScript) else parse_camera(str(camera), model)
            motion = BoundCameraScript(script, model, self._options.size)
            spans = [(0.0, times[-1]), *[(np.inf, np.inf)] * (len(script.shots) - 1)]
            motion.aim_at_motion(states, times, spans)
            return list(motion.poses(states, times, times, spans))

    def _rendered(
        self,
        model: mujoco.MjModel,
        visible: np.ndarray,
        cameras: Sequence[object],
        poses: Sequence[Sequence[CameraPose]],
        states: Sequence[np.ndarray],
        times: Sequence[float],
    ) -> Iterator[LabelledImage]:
        objects = labelled_objects(self._options, model)
        scene = _Objects(model, objects, visible)
        renderer = self._prepared(model)
        conditions = AcceptanceConditions(self._options, objects)
        for place, (state, time) in enumerate(zip(states, times, strict=True)):
            renderer.set_state(state)
            scene.set_state(state)
            for camera, track in zip(cameras, poses, strict=True):
                seen = renderer.render(track[place], ("rgb", "depth", "seg"))
                rgb, depth, bodies = seen.rgb, seen.depth, seen.ids
                assert rgb is not None
                assert depth is not None
                assert bodies is not None
                rgb = rgb.copy()  # which the next picture overwrites
                ids: np.ndarray = scene.owners_or_none[bodies]
                views = self._views(renderer, track[place], scene, seen, ids)
                name = camera.name if isinstance(camera, CameraScript) else str(camera)
                accepted = conditions.hold(views)
                yield LabelledImage(name, time, seen.calibration, rgb, depth, ids, bodies, views, accepted)

    def close(self) -> None:
        """Frees the driver's resources."""
        if self._renderer:
            self._renderer.close()
        self._renderer = None

    def _prepared(self, model: mujoco.MjModel) -> ClassicRenderer:
        """Returns a renderer of `model`, with the meshes and textures of an earlier one if they are equal."""
        segmentation = SegmentationIds(model, "body")
        if self._renderer and self._renderer.can_show(model):
            self._renderer.show(model, segmentation)
        else:
            self.close()
            self._renderer = ClassicRenderer(model, self._options.size, self._backend, self._visual, segmentation)
        return self._renderer

    def _views(
        self, renderer: ClassicRenderer, pose: CameraPose, scene: "_Objects", seen: CameraImages, ids: np.ndarray
    ) -> list[ObjectAnnotation]:
        found = {region.id: region for region in regions(ids)}
        masks = self._masks(renderer, pose, scene, seen.calibration)
        views = list[ObjectAnnotation]()
        for index, each in enumerate(scene.objects):
            silhouette, truncated, outline = self._silhouette(
                renderer, pose, scene, index, masks[index], _needed_scale(seen.calibration, scene.corners(index))
            )
            region = found.get(index)
            views.append(
                ObjectAnnotation(
                    object=each,
                    region=region,
                    pixels=region.area if region else 0,
                    silhouette=silhouette,
                    truncated=truncated,
                    outline=outline,
                    alone=masks[index] if self._outlines else None,
                    pose=np.linalg.inv(seen.calibration.pose) @ scene.pose(index),
                    box=scene.box(index),
                    keypoints=_keypoints(scene.keypoints(index), seen, ids == index),
                )
            )
        return views

    def _masks(
        self, renderer: ClassicRenderer, pose: CameraPose, scene: "_Objects", camera: CameraCalibration
    ) -> list[np.ndarray]:
        """Renders the silhouette of each object within the image; objects that cannot overlap share a rendering."""
        masks: list[np.ndarray] = [np.empty(0)] * len(scene.objects)
        for group in scene.groups(camera):
            with scene.alone(group):
                bodies = renderer.render(pose, ("seg",)).ids
            owners = scene.owners_or_none[bodies]
            for index in group:
                masks[index] = np.equal(owners, index)
        return masks

    def _silhouette(
        self,
        renderer: ClassicRenderer,
        pose: CameraPose,
        scene: "_Objects",
        index: int,
        mask: np.ndarray,
        scale: float,
    ) -> tuple[float, float, tuple[float, float, float, float]]:
        """Returns the area of the silhouette of an object, the share outside of the image, and the box around it.

        Args:
          mask: its silhouette within the image.
          scale: size of a view that contains all of it, relative to the image.
        """
        height, width = mask.shape
        inside = float(mask.sum())
        if scale <= 1:
            return inside, 0.0, _around(mask)
        with scene.alone([index]):
            wide = _mask(renderer.render(replace(pose, frustum=_widened(pose.frustum, scale)), ("seg",)))
        middle = np.array([width, height]) / 2
        rows, columns = np.nonzero(wide)
        places = (np.stack([columns, rows], axis=1) + 0.5 - middle) * scale + middle
        within = np.logical_and(places >= 0, places < [width, height]).all(axis=1)
        outside = float((~within).sum()) * scale**2
        x, y, across, down = _around(wide)
        corner = (np.array([x, y]) - middle) * scale + middle
        total = inside + outside
        share = outside / total if total else 0.0
        return total, share, (float(corner[0]), float(corner[1]), across * scale, down * scale)


class _Objects:
    """The objects of a model in its current state."""

    def __init__(self, model: mujoco.MjModel, objects: Sequence[ObjectToLabel], visible: np.ndarray) -> None:
        self.objects = objects
        self.owners = object_of_body(model, [each.body for each in objects])
        self.owners_or_none = np.append(self.owners, NOTHING).astype(np.int32)  # by the id of a body, −1 included
        self._model, self._data = model, mujoco.MjData(model)
        self._boxes = ObjectBoxes(model, [each.body for each in objects], self.owners, visible)
        bodies = {kind: _bodies_of(model, kind) for kind in GROUPED}
        self._owners = {kind: np.where(ids >= 0, self.owners[ids], -1) for kind, ids in bodies.items()}

    def set_state(self, state: np.ndarray) -> None:
        """Moves the model to an integration state."""
        mujoco.mj_setState(self._model, self._data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_flex(self._model, self._data)

    def pose(self, index: int) -> np.ndarray:
        """Returns the pose of an object `(4, 4)`, world from object."""
        matrix, body = np.eye(4), self.objects[index].body
        matrix[:3, :3] = self._data.xmat[body].reshape(3, 3)
        matrix[:3, 3] = self._data.xpos[body]
        return matrix

    def box(self, index: int) -> ObjectBox:
        """Returns the box around an object in its frame."""
        return self._boxes.box(index, self.pose(index), self._data)

    def corners(self, index: int) -> np.ndarray:
        """Returns the corners of the box around an object and of boxes around its sites `(n, 3)` [m]."""
        sites = np.flatnonzero(self._owners["site"] == index)
        reach = self._model.site_size[sites].max(axis=1, initial=0)[:, None, None]
        cubes = (self._data.site_xpos[sites][:, None] + CORNERS * reach).reshape(-1, 3)
        return np.concatenate([self.box(index).corners(self.pose(index)), cubes])

    def keypoints(self, index: int) -> np.ndarray:
        """Returns the positions of the keypoints of an object `(n, 3)` [m]."""
        return self._data.site_xpos[[*self.objects[index].keypoints]].reshape(-1, 3)

    def groups(self, camera: CameraCalibration) -> list[list[int]]:
        """Returns groups of objects of which no two can overlap in an image."""
        places, groups = [self._place(index, camera) for index in range(len(self.objects))], list[list[int]]()
        for index, place in enumerate(places):
            apart = (group for group in groups if not any(_overlap(place, places[other]) for other in group))
            group = next(apart, None)
            if group is None:
                groups.append([index])
            else:
                group.append(index)
        return groups

    def _place(self, index: int, camera: CameraCalibration) -> np.ndarray:
        """Returns the left, top, right and bottom end of everything of an object in an image [pixels]."""
        pixels = camera.project(self.corners(index))
        if (pixels[:, 2] <= camera.near).any():
            return EVERYWHERE
        low, high = pixels[:, :2].min(axis=0), pixels[:, :2].max(axis=0)
        return np.concatenate([low - APART, high + APART])

    @contextmanager
    def alone(self, indices: Sequence[int]) -> Generator[None]:
        """Hides everything except these objects within the block."""
        model = self._model
        before = {kind: getattr(model, f"{kind}_group").copy() for kind in GROUPED}
        try:
            for kind, owners in self._owners.items():
                getattr(model, f"{kind}_group")[~np.isin(owners, indices)] = HIDDEN_GROUP
            yield
        finally:
            for kind, groups in before.items():
                getattr(model, f"{kind}_group")[:] = groups


def _bodies_of(model: mujoco.MjModel, kind: str) -> np.ndarray:
    """Returns the body that each object of a kind belongs to; −1 for none."""
    match kind:
        case "geom":
            return np.array(model.geom_bodyid)
        case "site":
            return np.array(model.site_bodyid)
        case "flex":
            return flex_owners(model)
        case "skin":
            return skin_owners(model)
        case _:
            return np.full(int(model.ntendon), NOTHING)


def _overlap(place: np.ndarray, other: np.ndarray) -> bool:
    return bool((place[:2] < other[2:]).all() and (other[:2] < place[2:]).all())


def _mask(seen: CameraImages) -> np.ndarray:
    assert seen.ids is not None
    mask: np.ndarray = seen.ids >= 0
    return mask


def _around(mask: np.ndarray) -> tuple[float, float, float, float]:
    """Returns x, y, width and height of the box around a mask [pixels]; zeros for an empty one."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return 0.0, 0.0, 0.0, 0.0
    x, y = float(columns[0]), float(rows[0])
    return x, y, float(columns[-1]) + 1 - x, float(rows[-1]) + 1 - y


def _needed_scale(camera: CameraCalibration, corners: np.ndarray) -> float:
    """Returns the size of a view around the middle of an image that contains `corners`, relative to the image."""
    pixels = camera.project(corners)
    if (pixels[:, 2] <= camera.near).any():
        return WIDEST
    half = np.array(camera.size) / 2
    needed = float((np.abs(pixels[:, :2] - half) / half).max())
    return min(1.02 * needed, WIDEST) if needed > 1 else 1.0


def _widened(frustum: Frustum, scale: float) -> Frustum:
    """Returns a frustum whose image is larger by `scale` around the middle of the image."""
    middle, half = (frustum.top + frustum.bottom) / 2, (frustum.top - frustum.bottom) / 2
    return replace(frustum, bottom=middle - scale * half, top=middle + scale * half, width=frustum.width * scale)


def _keypoints(points: np.ndarray, seen: CameraImages, own: np.ndarray) -> np.ndarray:
    """Projects keypoints; one is visible where its object is, or where nothing is nearer."""
    assert seen.depth is not None
    camera = seen.calibration
    width, height = camera.size
    labels = np.zeros((len(points), 3))
    for label, (u, v, depth) in zip(labels, camera.project(points), strict=True):
        if depth <= camera.near or not (0 <= u < width and 0 <= v < height):
            continue
        place = int(v), int(u)
        is_visible = own[place] or seen.depth[place] >= depth
        label[:] = u, v, 2 if is_visible else 1
    return labels


def _ancestors(model: mujoco.MjModel, body: int) -> Iterator[int]:
    while body:
        body = int(model.body_parentid[body])
        yield body


class _GeomType(IntEnum):
    """The types of geoms, which patterns can name."""

    PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
    SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE.value
    CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE.value
    ELLIPSOID = mujoco.mjtGeom.mjGEOM_ELLIPSOID.value
    CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER.value
    BOX = mujoco.mjtGeom.mjGEOM_BOX.value
    MESH = mujoco.mjtGeom.mjGEOM_MESH.value
    SDF = mujoco.mjtGeom.mjGEOM_SDF.value


class ObjectBoxes:
    """The boxes around the visible geoms, the flexes and the skins of objects.

    They are exact for geoms of the object's own body; other geoms are as large as their own boxes.

    Args:
      roots: the body of each object.
      owners: the object that each body belongs to `(nbody,)`, −1 for none.
      visible: a flag for each geom, true if it is visible `(ngeom,)`.
    """

    def __init__(self, model: mujoco.MjModel, roots: Sequence[int], owners: np.ndarray, visible: np.ndarray) -> None:
        self._parts: dict[int, list[tuple[int, np.ndarray]]] = {}  # by object: bodies, and corners in their frames
        bounded = (model.geom_type != _GeomType.PLANE) | (model.geom_size[:, :2] > 0).all(axis=1)
        for geom in np.flatnonzero(visible & bounded):
            body = int(model.geom_bodyid[geom])
            if (owner := int(owners[body])) >= 0:
                corners = (_exact_corners if body == roots[owner] else _own_corners)(model, int(geom))
                self._parts.setdefault(owner, []).append((body, corners))
        self._flexes = _vertex_owners(owners, flex_owners(model), model.flex_group, model.flex_vertnum)
        self._skins = _vertex_owners(owners, skin_owners(model), model.skin_group, model.skin_vertnum)
        self._model, self._scene = model, mujoco.MjvScene(model, 1)  # which computes the vertices of skins

    def box(self, index: int, pose: np.ndarray, data: mujoco.MjData) -> ObjectBox:
        """Returns the box around an object at `pose` `(4, 4)`, world from object; empty if nothing is visible."""
        points = [
            data.xpos[body] + corners @ data.xmat[body].reshape(3, 3).T for body, corners in self._parts.get(index, ())
        ]
        points.append(data.flexvert_xpos[self._flexes == index])
        if index in self._skins:
            mujoco.mjv_updateScene(self._model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), 0, self._scene)
            points.append(self._scene.skinvert.reshape(-1, 3)[self._skins == index])
        if not any(map(len, points)):
            return ObjectBox(np.zeros(3), np.zeros(3))
        local = (np.concatenate(points) - pose[:3, 3]) @ pose[:3, :3]
        low, high = local.min(axis=0), local.max(axis=0)
        return ObjectBox((low + high) / 2, high - low)


def _vertex_owners(owners: np.ndarray, bodies: np.ndarray, groups: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Returns the object of each vertex of flexes or skins, −1 for none.

    Args:
      owners: the object that each body belongs to.
      bodies, groups, counts: the body, the group and the number of vertices of each flex or skin.
    """
    visible = np.isin(groups, VISIBLE_GROUPS)
    return np.repeat(np.where(visible, np.append(owners, -1)[bodies], -1), counts)


def _own_corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Returns the corners of the box around a geom along its own axes, in the frame of its body `(8, 3)` [m]."""
    center, half = model.geom_aabb[geom].reshape(2, 3)
    if model.geom_type[geom] == _GeomType.PLANE:  # whose box is infinite
        center, half = np.zeros(3), model.geom_size[geom] * [1, 1, 0]
    corners: np.ndarray = model.geom_pos[geom] + (center + CORNERS * half) @ _turn(model, geom).T
    return corners


def _exact_corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Returns the corners of the smallest box around a geom along the axes of its body, in its frame `(8, 3)` [m]."""
    turn, place = _turn(model, geom), model.geom_pos[geom]
    size, axis = model.geom_size[geom], turn[:, 2]
    match model.geom_type[geom]:
        case _GeomType.MESH | _GeomType.SDF:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            points = place + model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ turn.T
            low, high = points.min(axis=0), points.max(axis=0)
            return (low + high) / 2 + CORNERS * (high - low) / 2
        case _GeomType.SPHERE:
            half = np.full(3, size[0])
        case _GeomType.CAPSULE:
            half = np.abs(axis) * size[1] + size[0]
        case _GeomType.CYLINDER:
            half = np.abs(axis) * size[1] + size[0] * np.sqrt(np.maximum(1 - axis**2, 0))
        case _GeomType.ELLIPSOID:
            half = np.sqrt(((turn * size) ** 2).sum(axis=1))
        case _GeomType.BOX:
            half = np.abs(turn) @ size
        case _:  # a height field or a plane
            return _own_corners(model, geom)
    return place + CORNERS * half


def _turn(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Returns the rotation `(3, 3)`, body from geom."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    return matrix.reshape(3, 3)
