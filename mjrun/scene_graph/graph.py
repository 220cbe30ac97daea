"""A scene as plain values, in MuJoCo's axes (z up) and units (metres, radians, quaternions w x y z)."""

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
    """Triangles; the same object is the mesh of several nodes.

    Attributes:
      positions: `(n, 3)` float32 [m].
      normals: `(n, 3)` float32, of length 1.
      faces: indices of the vertices, `(m, 3)`, counter-clockwise seen from outside.
      uv: texture coordinates `(n, 2)` float32, from the first row and column of the texture; None without texture.
    """

    name: str
    positions: np.ndarray
    normals: np.ndarray
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
    """

    name: str
    rgba: tuple[float, float, float, float]
    metallic: float
    roughness: float
    emission: float = 0.0
    texture: Texture | None = None


@dataclass(frozen=True)
class CameraLens:
    """The field of view of a camera, which looks along −z with y up.

    Attributes:
      fovy: the vertical field of view [rad]; the height of the view [m] if orthographic.
      aspect: width by height.
      near, far: distances of the clipping planes [m].
    """

    fovy: float
    aspect: float
    near: float
    far: float
    orthographic: bool = False


@dataclass(frozen=True)
class Light:
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


@dataclass(frozen=True)
class Node:
    """An object with a place in the scene.

    Attributes:
      name: its name, or `geom:3`.
      kind: `world`, `body`, `geom`, `site`, `camera` or `light`, or `shot` for a camera that is not the model's.
      id: its MuJoCo id within that kind.
      parent: index of the node that its pose is relative to; −1 for the world.
      position, quaternion, scale: its pose, at the first frame if it moves.
      moves: true if it may move relative to its parent.
      visible: true if it is shown; others are included for viewers that can show them.
      layer: `visual`, `collision` or `both` for geoms: what they are for.
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
    light: Light | None = None
    visible: bool = True
    layer: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict[str, Fact])


@dataclass(frozen=True)
class SceneGraph:
    """All visible objects of a model.

    Attributes:
      nodes: the world, then every other node after its parent.
      remarks: objects that are visible in images of MuJoCo, and not part of the scene, in sentences for the user.
    """

    nodes: Sequence[Node]
    remarks: Sequence[str] = ()

    @property
    def moving(self) -> list[int]:
        """The indices of the nodes that may move relative to their parents."""
        return [index for index, node in enumerate(self.nodes) if node.moves]


@dataclass(frozen=True, eq=False)
class SceneMotion:
    """The poses of the moving nodes at each frame, relative to their parents.

    Attributes:
      times: the time of each frame in the file, from 0, ascending [s], `(n,)`.
      nodes: the indices of the moving nodes.
      positions: `(n, k, 3)` float64 [m].
      quaternions: `(n, k, 4)` float64.
    """

    times: np.ndarray
    nodes: Sequence[int]
    positions: np.ndarray
    quaternions: np.ndarray
