"""Fingerprints of compiled models: of the whole model, and of its physics alone."""

import hashlib
from collections.abc import Iterator
from functools import cache

import mujoco
import numpy as np

# Arrays of MjModel that only affect images, keyframes and names, and their sizes.
VISUAL = ("cam_", "key_", "light_", "mat_", "name_", "names", "paths", "skin_", "tex_", "text_")
VISUAL += ("nbuffer", "ncam", "nkey", "nlight", "nmat", "nnames", "npaths", "nskin", "ntex", "signature")
VISUAL_SUFFIXES = ("_rgba", "_group", "_matid", "_texcoord", "_texcoordadr", "_texcoordnum")
LOCATIONS = ("_pathadr", "npaths", "nbuffer")  # fields that depend on the lengths of file names


def model_fingerprint(model: mujoco.MjModel) -> str:
    """Returns the SHA-256 of the compiled model, with all its assets and overrides."""
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return hashlib.sha256(content.data).hexdigest()


def content_fingerprint(model: mujoco.MjModel) -> str:
    """Returns the SHA-256 of the compiled model with all its assets, independent of the folder of their files."""
    digest = hashlib.sha256()
    for name, value in _fields(model):
        if name != "paths" and not name.endswith(LOCATIONS):
            digest.update(name.encode() + b"\0" + value)
    return digest.hexdigest()


def _fields(owner: object) -> Iterator[tuple[str, bytes]]:
    """Yields the numbers, texts and arrays of a structure and of its inner structures."""
    for name in _public(type(owner)):
        value = getattr(owner, name)
        if isinstance(value, bytes):
            yield name, value
        elif isinstance(value, (int, float, np.ndarray, np.generic)):
            yield name, np.ascontiguousarray(value).data.tobytes()
        elif type(value).__module__ == type(owner).__module__:
            yield from _fields(value)


def physics_fingerprint(model: mujoco.MjModel) -> str:
    """Returns the SHA-256 of the options, and of every array that does not only affect images, keyframes and names."""
    digest = hashlib.sha256()
    for name, value in physics_fields(model):
        digest.update(name.encode() + b"\0" + value.tobytes())
    return digest.hexdigest()


def physics_fields(model: mujoco.MjModel) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the numbers and arrays of a model and of its options, except those that only affect images and names."""
    for owner in (model, model.opt):
        for name in _names(type(owner)):
            value = getattr(owner, name)
            if isinstance(value, (int, float, np.ndarray, np.generic)):
                yield name, np.asarray(value)


@cache
def _names(owner: type) -> tuple[str, ...]:
    return tuple(name for name in _public(owner) if not name.startswith(VISUAL) and not name.endswith(VISUAL_SUFFIXES))


@cache
def _public(owner: type) -> tuple[str, ...]:
    return tuple(name for name in sorted(dir(owner)) if not name.startswith("_"))
