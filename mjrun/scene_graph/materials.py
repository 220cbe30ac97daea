"""Materials, textures, and the coordinates at which MuJoCo's renderer places textures on shapes.

The coordinates follow the function `settexture` of MuJoCo's classic renderer, in src/render/classic/render_gl3.c.
"""

import itertools
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.model.names import object_names
from mjrun.scene_graph.graph import Material, Mesh, Texture, Vector
from mjrun.scene_graph.meshes import unique_rows

RGB, RGBA = int(mujoco.mjtTextureRole.mjTEXROLE_RGB), int(mujoco.mjtTextureRole.mjTEXROLE_RGBA)
FLAT = int(mujoco.mjtTexture.mjTEXTURE_2D)
PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
EDGE = 1e-9  # distance from a plane, relative to the mesh, within which a vertex is on it
PADDING = 4  # pixels around each face of an atlas, so that coarser levels of detail do not mix faces
COLUMNS, ROWS = 3, 2  # of an atlas
# The axis along s, its sign, the axis along t and its sign, for the faces +x −x +y −y +z −z:
# https://registry.khronos.org/OpenGL/specs/gl/glspec46.core.pdf, table 8.19.
CUBE = ((2, -1, 1, -1), (2, 1, 1, -1), (0, 1, 2, 1), (0, 1, 2, -1), (0, 1, 1, -1), (0, -1, 1, -1))


@dataclass(frozen=True)
class TextureMapping:
    """The placement of a texture on a shape.

    Attributes:
      texture: the id of the texture.
      kind: `uv` for the coordinates of the mesh, `planar` for a projection along z, `cube` for a cube map.
      scale: factors of the coordinates, of x and y, or from vertices to directions in the cube.
      offset: added to the coordinates after scaling.
    """

    texture: int
    kind: str
    scale: tuple[float, ...]
    offset: float = 0.0

    def applied(self, mesh: Mesh, size: int) -> Mesh:
        """Returns a mesh with texture coordinates; for a cube map, cut where its faces meet.

        Args:
          size: width of a face of the cube map [pixels].
        """
        if self.kind == "cube":
            return cube_mapped(mesh, np.array(self.scale), size)
        if self.kind == "planar":
            uv = 0.5 * mesh.positions[:, :2] * (self.scale[0], -self.scale[1])
        else:
            assert mesh.uv is not None
            uv = mesh.uv * self.scale
        return replace(mesh, uv=(uv + self.offset).astype(np.float32))


class MaterialCache:
    """A cache of the materials of a model, each made once."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._materials: dict[Material, Material] = {}
        self._textures: dict[tuple[int, bool], Texture] = {}

    def mapping(self, geom: mujoco.MjvGeom, unit: Vector, *, is_asset: bool, has_uv: bool) -> TextureMapping | None:
        """Returns the placement of a geom's texture; None if it has none.

        Args:
          unit: the length of 1 in its mesh along each axis [m].
          is_asset: its mesh is one of the model, rather than a primitive shape.
          has_uv: its mesh has texture coordinates.
        """
        model, index = self._model, self._texture_id(geom)
        if index < 0:
            return None
        size, scale, material = np.maximum(geom.size.astype(float), 0), np.array(unit), int(geom.matid)
        is_uniform, lengths = bool(model.mat_texuniform[material]), np.where(size > 0, size, 1)
        if int(model.tex_type[index]) != FLAT:
            if is_asset == is_uniform:
                scale = scale * size if is_uniform else scale / lengths
            return TextureMapping(index, "cube", tuple(map(_short, scale / scale.max())))
        repeat = model.mat_texrepeat[material].astype(float)
        if has_uv:
            repeat = np.where(repeat > 0, repeat, 1) * (lengths[:2] if is_uniform else 1)
            is_infinite = int(geom.type) == PLANE and not size[:2].all()
            return TextureMapping(index, "uv", tuple(map(_short, repeat)), -0.5 if is_infinite else 0.0)
        scale = repeat * scale[:2] / (1 if is_uniform else lengths[:2])
        return TextureMapping(index, "planar", tuple(map(_short, scale)), -0.5)

    def material(self, geom: mujoco.MjvGeom, mapping: TextureMapping | None, two_sided: bool = False) -> Material:
        """Returns the material of a geom."""
        model, index = self._model, int(geom.matid)
        red, green, blue, alpha = (_short(part) for part in geom.rgba)
        metallic, roughness = (model.mat_metallic[index], model.mat_roughness[index]) if index >= 0 else (-1.0, -1.0)
        made = Material(
            name=clean(object_names(model, "material", [index])[0]) if index >= 0 else "color",
            rgba=(red, green, blue, alpha),
            metallic=max(float(metallic), 0.0),
            roughness=float(roughness) if roughness >= 0 else _roughness(float(geom.specular), float(geom.shininess)),
            emission=float(geom.emission),
            texture=self.texture(mapping.texture, is_opaque=alpha >= 1) if mapping else None,
            two_sided=two_sided,
        )
        return self._materials.setdefault(made, made)

    def texture(self, index: int, *, is_opaque: bool = False) -> Texture:
        """Returns a texture; a cube map as an atlas of its faces.

        Args:
          is_opaque: leaves out its opacity, which MuJoCo's renderer ignores on geoms of opacity 1.
        """
        key = index, is_opaque
        if key not in self._textures:
            pixels = texture_pixels(self._model, index)
            if is_opaque:
                pixels = pixels[..., :3]
            if int(self._model.tex_type[index]) != FLAT:
                pixels = atlas(pixels.reshape(6, -1, *pixels.shape[1:]))
            self._textures[key] = Texture(clean(object_names(self._model, "texture", [index])[0]), pixels)
        return self._textures[key]

    def _texture_id(self, geom: mujoco.MjvGeom) -> int:
        if geom.matid < 0 or geom.texid == -1:  # without textures, MuJoCo's scene has neither
            return -1
        roles = self._model.mat_texid[geom.matid]
        return int(roles[RGB] if roles[RGB] >= 0 else roles[RGBA])


def texture_pixels(model: mujoco.MjModel, index: int) -> np.ndarray:
    """Returns the pixels of a texture `(height, width, 3 or 4)`; the faces of a cube map are above each other."""
    height, width, channels = (int(values[index]) for values in (model.tex_height, model.tex_width, model.tex_nchannel))
    start = int(model.tex_adr[index])
    pixels = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
    return pixels.copy() if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=2)


def atlas(faces: np.ndarray) -> np.ndarray:
    """Returns the six faces of a cube map, `(6, size, size, channels)`, beside each other with wide edges."""
    padded = np.pad(faces, ((0, 0), (PADDING, PADDING), (PADDING, PADDING), (0, 0)), mode="edge")
    rows = [np.concatenate([*padded[row * COLUMNS : (row + 1) * COLUMNS]], axis=1) for row in range(ROWS)]
    return np.concatenate(rows, axis=0)


def cube_mapped(mesh: Mesh, scale: np.ndarray, size: int) -> Mesh:
    """Returns a mesh with the coordinates of an atlas, cut along the planes on which the faces of the cube meet.

    Args:
      scale: factors from vertices to directions in the cube.
      size: width of a face [pixels].
    """
    assert mesh.normals is not None
    corners = np.concatenate([mesh.positions, mesh.normals], axis=1).astype(float)[mesh.faces]
    for (i, j), sign in itertools.product(itertools.combinations(range(3), 2), (1, -1)):
        normal = np.zeros(3)
        normal[i], normal[j] = scale[i], sign * scale[j]
        corners = _cut(corners, normal)

    middle = corners[:, :, :3].mean(axis=1) * scale
    axis = np.abs(middle).argmax(axis=1)
    face = 2 * axis + (np.take_along_axis(middle, axis[:, None], axis=1)[:, 0] < 0)
    vertices = np.concatenate([corners, np.broadcast_to(face[:, None, None], (*corners.shape[:2], 1))], axis=2)
    vertices = vertices.reshape(-1, 7)
    units = np.array([max(float(np.abs(mesh.positions).max(initial=0)), np.finfo(float).tiny)] * 3 + [1.0] * 4)
    first, inverse = unique_rows((vertices / units).round(6))  # the same corner, but for rounding
    vertices = vertices[first]
    positions, normals, face = vertices[:, :3], vertices[:, 3:6], vertices[:, 6].astype(int)
    faces = inverse.reshape(-1, 3)
    faces = faces[(faces != faces[:, [1, 2, 0]]).all(axis=1)]  # where a cut meets a corner, triangles vanish
    return Mesh(
        mesh.name,
        positions.astype(np.float32),
        (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        faces.astype(np.uint32),
        _atlas_coordinates(positions * scale, face, size).astype(np.float32),
    )


def _atlas_coordinates(directions: np.ndarray, face: np.ndarray, size: int) -> np.ndarray:
    """Returns the coordinates in an atlas `(n, 2)` of directions `(n, 3)` in the cube, each on a `face`."""
    across, across_sign, down, down_sign = np.array(CUBE)[face].T
    rows = np.arange(len(face))
    depth = np.maximum(np.abs(directions[rows, face // 2]), np.finfo(float).tiny)
    inside = np.column_stack([across_sign * directions[rows, across], down_sign * directions[rows, down]])
    inside = ((inside / depth[:, None]).clip(-1, 1) + 1) / 2
    whole = size + 2 * PADDING
    place = np.column_stack([face % COLUMNS, face // COLUMNS]) * whole + PADDING
    return (place + inside * size) / (COLUMNS * whole, ROWS * whole)


def _cut(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Returns triangles, with corners `(n, 3, attributes)`, cut where they cross a plane through the origin."""
    distances = corners[:, :, :3] @ normal
    near = EDGE * max(float(np.abs(distances).max(initial=0)), np.finfo(float).tiny)
    sides = np.where(np.abs(distances) <= near, 0, np.sign(distances))
    crossing = (sides.max(axis=1) > 0) & (sides.min(axis=1) < 0)
    cut, distances, sides = corners[crossing], distances[crossing], sides[crossing]
    # The corner that is alone on its side comes first.
    alone = np.argmin(np.where(sides.sum(axis=1, keepdims=True) > 0, sides, -sides), axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    cut = np.take_along_axis(cut, order[:, :, None], axis=1)
    distances = np.take_along_axis(distances, order, axis=1)
    a, b, c = cut.transpose(1, 0, 2)
    ab, ac = (_between(a, other, distances[:, 0], distances[:, k]) for k, other in ((1, b), (2, c)))
    parts = [np.stack(part, axis=1) for part in ((a, ab, ac), (ab, b, c), (ab, c, ac))]
    return np.concatenate([corners[~crossing], *parts])


def _between(a: np.ndarray, b: np.ndarray, at_a: np.ndarray, at_b: np.ndarray) -> np.ndarray:
    """Returns the points where lines from a to b cross the plane, given the distances of their ends."""
    share = at_a / (at_a - at_b)
    return a + share[:, None] * (b - a)


def _roughness(specular: float, shininess: float) -> float:
    """Returns the roughness of a material of MuJoCo's classic renderer: its highlights are weak and wide, or sharp."""
    return 1.0 - 0.5 * min(max(shininess * min(2 * specular, 1.0), 0.0), 1.0)


def _short(value: float) -> float:
    """Returns a float32 number as the shortest decimal number."""
    return float(f"{value:.7g}")
