"""Cameras and lights."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco

from mjrun.model.description.plain_values import CAMERA, body_name, enum_name, floats, object_name


@dataclass(frozen=True)
class Camera:
    """A camera.

    Attributes:
      id, name, body: the camera and the body that it is fixed to.
      mode: `fixed`, `track`, `trackcom`, `targetbody` or `targetbodycom`.
      target: the body that it turns to; None without one.
      projection: `perspective` or `orthographic`.
      fovy: angle of view from top to bottom [°]; None for a camera that is orthographic or has a sensor size.
      height: what an orthographic camera sees from top to bottom [m]; None for another.
      sensor_size, focal_length, principal_point: [m]; the point is where the optical axis meets the image, from
        its centre. None for a camera that fovy describes.
      resolution: width and height that it was made for [px]; (1, 1) if not set. Images do not follow it.
      outputs: kinds of images that it was made for: `rgb`, `depth` …
      position: in its body [m].
    """

    id: int
    name: str
    body: str
    mode: str
    target: str | None
    projection: str
    fovy: float | None
    height: float | None
    sensor_size: tuple[float, ...] | None
    focal_length: tuple[float, ...] | None
    principal_point: tuple[float, ...] | None
    resolution: tuple[int, int]
    outputs: tuple[str, ...]
    position: tuple[float, ...]


def cameras(model: mujoco.MjModel) -> Iterator[Camera]:
    """Every camera, in order of id."""
    for i in range(model.ncam):
        projection, bits = enum_name(mujoco.mjtProjection, model.cam_projection[i]), int(model.cam_output[i])
        flat, intrinsic = projection == "orthographic", bool(model.cam_sensorsize[i, 1])
        yield Camera(
            id=i,
            name=object_name(model, CAMERA, i) or "",
            body=body_name(model, model.cam_bodyid[i]),
            mode=enum_name(mujoco.mjtCamLight, model.cam_mode[i]),
            target=object_name(model, mujoco.mjtObj.mjOBJ_BODY, model.cam_targetbodyid[i]),
            projection=projection,
            fovy=None if flat or intrinsic else float(model.cam_fovy[i]),
            height=float(model.cam_fovy[i]) if flat else None,
            sensor_size=floats(model.cam_sensorsize[i]) if intrinsic else None,
            focal_length=floats(model.cam_intrinsic[i, :2]) if intrinsic else None,
            principal_point=floats(model.cam_intrinsic[i, 2:]) if intrinsic else None,
            resolution=(int(model.cam_resolution[i, 0]), int(model.cam_resolution[i, 1])),
            outputs=tuple(enum_name(mujoco.mjtCamOutBit, 1 << k) for k in range(bits.bit_length()) if bits >> k & 1),
            position=floats(model.cam_pos[i]),
        )


@dataclass(frozen=True)
class Light:
    """A light.

    Attributes:
      id, name, body: the light and the body that it is fixed to.
      type: `spot`, `directional`, `point` or `image`.
      mode, target: as of a camera.
      position: in its body [m].
      active, shadow: shines; casts shadows.
    """

    id: int
    name: str
    body: str
    type: str
    mode: str
    target: str | None
    position: tuple[float, ...]
    active: bool
    shadow: bool


def lights(model: mujoco.MjModel) -> Iterator[Light]:
    """Every light, in order of id."""
    for i in range(model.nlight):
        yield Light(
            id=i,
            name=object_name(model, mujoco.mjtObj.mjOBJ_LIGHT, i) or "",
            body=body_name(model, model.light_bodyid[i]),
            type=enum_name(mujoco.mjtLightType, model.light_type[i]),
            mode=enum_name(mujoco.mjtCamLight, model.light_mode[i]),
            target=object_name(model, mujoco.mjtObj.mjOBJ_BODY, model.light_targetbodyid[i]),
            position=floats(model.light_pos[i]),
            active=bool(model.light_active[i]),
            shadow=bool(model.light_castshadow[i]),
        )
