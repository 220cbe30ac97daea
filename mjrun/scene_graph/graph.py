"""A scene as plain values, in MuJoCo's axes (z up) and units (metres, radians, quaternions w x y z)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np

from mjrun.dataclass import dataclass

ORIGIN = (0.0, 0.0, 0.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
ONES = (1.0, 1.0, 1.0)

Fact = str | int | float | bool | Sequence[str] | Sequence[float]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles or lines; the same object is the mesh of several nodes.

    Attributes:
      positions: `(n, 3)` float32 [m].
      normals: `(n, 3)` float32, of length 1; None for lines.
      faces: indices of the vertices: of triangles `(m, 3)`, counter-clockwise from outside, or of lines `(m, 2)`.
      uv: texture coordinates `(n, 2)` float32, from the first row and column of the texture; None without texture.
    """

    name: str
    positions: np.ndarray
    normals: np.ndarray | None
    faces: np.ndarray
    uv: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Texture:
    """An image on a surface, which repeats.

    Attributes:
      pixels: `(height, width, channels)` uint8, 3 or 4 channels.
    """

    name: str
    pixels: np.ndarray


@dataclass(frozen=True)
class Material:
    """The look of a surface.

    Attributes:
      rgba: colour and opacity, from 0 to 1, as MuJoCo specifies and screens show them (sRGB).
      metallic, roughness: the parameters of glTF, from 0 to 1.
      emission: light that it emits, in multiples of its colour.
      texture: an image that multiplies the colour.
      two_sided: true if its back is visible.
    """

    name: str
    rgba: tuple[float, float, float, float]
    metallic: float
    roughness: float
    emission: float = 0.0
    texture: Texture | None = None
    two_sided: bool = False


@dataclass(frozen=True)
class CameraLens:
    """The field of view of a camera, which looks along −z with y up.

    Attributes:
      fovy: the vertical field of view, if its middle is on the axis [rad]; the height of the view [m] if orthographic.
      aspect: width by height.
      near, far: distances of the clipping planes [m].
      shift: place of the middle of the view to the right of the axis and above it, in heights of the view.
    """

    fovy: float
    aspect: float
    near: float
    far: float
    orthographic: bool = False
    shift: tuple[float, float] = (0.0, 0.0)


def camera_lens(
    sides: tuple[float, float], ends: tuple[float, float], clip: tuple[float, float], *, orthographic: bool
) -> CameraLens:
    """Returns the lens whose view on the near plane reaches from left to right and from bottom to top [m].

    Args:
      clip: distances of the near and the far plane [m].
    """
    (left, right), (bottom, top), (near, far) = sides, ends, clip
    height = top - bottom
    fovy = height if orthographic else 2 * math.atan2(height / 2, near)
    shift = (left + right) / 2 / height, (bottom + top) / 2 / height
    return CameraLens(fovy, (right - left) / height, near, far, orthographic, shift)


@dataclass(frozen=True)
class SceneLight:
    """A light, which shines along −z.

    Attributes:
      kind: `directional`, `point` or `spot`.
      color: its colour, from 0 to 1 (sRGB).
      intensity: the illuminance of a directional light [lx], or the luminous intensity of others [cd], on a scale on
        which a surface under π lx has the brightness of its colour.
      range: distance beyond which it does not shine [m]; 0 is no limit.
      cutoff: half the opening of the cone of a spot [rad].
    """

    kind: str
    color: Vector
    intensity: float
    range: float = 0.0
    cutoff: float = 0.0


@dataclass(frozen=True, eq=False)
class Skin:
    """The binding of a mesh to bodies, which move its vertices.

    Attributes:
      nodes: the indices of the nodes of the bodies.
      binds: the transformation from the mesh to each body where it is bound, `(k, 4, 4)`.
      joints: the bodies of each vertex, as indices into `nodes`, `(n, 4)`.
      weights: their shares, which add up to 1; 0 for unused ones.
    """

    nodes: Sequence[int]
    binds: np.ndarray
    joints: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class Node:
    """An object with a place in the scene.

    Attributes:
      name: its name, or `geom:3`.
      kind: `world`, `body`, `geom`, `site`, `camera`, `light`, `flex`, `skin`, `tendon`, `joint` or `actuator`; `shot`
        for a camera that is not the model's, `contact` for contacts and their forces, `decoration` for other objects.
      id: its MuJoCo id within that kind; −1 for objects without one.
      parent: index of the node that its pose is relative to; −1 for the world.
      position, quaternion, scale: its pose, at the first frame if it moves.
      moves: true if it may move relative to its parent.
      visible: true if it is shown; others are included for viewers that can show them.
      layer: what it is for: `visual`, `collision` or `both` for geoms; `contactpoint` or `contactforce` for contacts.
      facts: numbers and names for programs that read the file.
    """

    name: str
    kind: str
    id: int
    parent: int
    position: Vector = ORIGIN
    quaternion: Quaternion = IDENTITY
    scale: Vector = ONES
    moves: bool = False
    mesh: Mesh | None = None
    material: Material | None = None
    lens: CameraLens | None = None
    light: SceneLight | None = None
    skin: Skin | None = None
    visible: bool = True
    layer: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict[str, Fact])


@dataclass(frozen=True)
class SceneGraph:
    """The objects of a model that are visible.

    Attributes:
      nodes: the world, then every other node after its parent.
      remarks: objects that are visible in images of MuJoCo, and not part of the scene, in sentences for the user.
      facts: the extent and the centre of the model, the colours of its sky, and its headlight.
    """

    nodes: Sequence[Node]
    remarks: Sequence[str] = ()
    facts: Mapping[str, Fact] = field(default_factory=dict[str, Fact])


@dataclass(frozen=True, eq=False)
class Track:
    """The poses of one node at some frames; between them, it keeps the pose of the frame before.

    Attributes:
      frames: the indices of the frames, ascending from 0, `(m,)`.
      positions, quaternions: its poses, `(m, 3)` [m] and `(m, 4)`.
      scales: its sizes `(m, 3)`; 0 where it is absent.
      smooth: true if it moves linearly between frames.
    """

    node: int
    frames: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray
    scales: np.ndarray
    smooth: bool


@dataclass(frozen=True, eq=False)
class Deformation:
    """The vertices of a node's mesh at some frames; between them, they move linearly.

    Attributes:
      frames: the indices of the frames, ascending from 0, `(m,)`.
      positions, normals: those of all vertices, `(m, n, 3)` float32.
    """

    node: int
    frames: np.ndarray
    positions: np.ndarray
    normals: np.ndarray


@dataclass(frozen=True, eq=False)
class SceneMotion:
    """The motion of a scene.

    Attributes:
      times: the time of each frame in the file, from 0, ascending [s], `(n,)`.
      nodes: the indices of nodes with a pose at each frame.
      positions, quaternions: their poses relative to their parents, `(n, k, 3)` [m] and `(n, k, 4)`, float64.
      tracks: the motion of nodes that come and go, or change their size.
      deformations: the motion of vertices.
    """

    times: np.ndarray
    nodes: Sequence[int]
    positions: np.ndarray
    quaternions: np.ndarray
    tracks: Sequence[Track] = ()
    deformations: Sequence[Deformation] = ()
