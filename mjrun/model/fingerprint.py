"""Fingerprints of compiled models: of all of a model, and of its physics alone."""

import hashlib
from collections.abc import Iterator
from functools import cache

import mujoco
import numpy as np

# Arrays of MjModel that only affect images, keyframes and names, and the numbers of their entries.
VISUAL = ("cam_", "key_", "light_", "mat_", "name_", "names", "paths", "skin_", "tex_", "text_")
VISUAL += ("nbuffer", "ncam", "nkey", "nlight", "nmat", "nnames", "npaths", "nskin", "ntex", "signature")
VISUAL_SUFFIXES = ("_rgba", "_group", "_matid", "_texcoord", "_texcoordadr", "_texcoordnum")


def model_fingerprint(model: mujoco.MjModel) -> str:
    """SHA-256 of the compiled model, with all its assets and overrides."""
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return hashlib.sha256(content.data).hexdigest()


def physics_fingerprint(model: mujoco.MjModel) -> str:
    """SHA-256 of the options, and of every array that does not only affect images, keyframes and names."""
    digest = hashlib.sha256()
    for name, value in physics_fields(model):
        digest.update(name.encode() + b"\0" + value.tobytes())
    return digest.hexdigest()


def physics_fields(model: mujoco.MjModel) -> Iterator[tuple[str, np.ndarray]]:
    """The numbers and arrays of a model and of its options, by name, but for what only affects images and names."""
    for owner in (model, model.opt):
        for name in _names(type(owner)):
            value = getattr(owner, name)
            if isinstance(value, (int, float, np.ndarray, np.generic)):
                yield name, np.asarray(value)


@cache
def _names(owner: type) -> tuple[str, ...]:
    public = [name for name in sorted(dir(owner)) if not name.startswith(("_", *VISUAL))]
    return tuple(name for name in public if not name.endswith(VISUAL_SUFFIXES))
