"""Fingerprints of compiled models: of all of a model, and of its physics alone."""

import hashlib

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
    for owner in (model, model.opt):
        for name in sorted(dir(owner)):
            if name.startswith(("_", *VISUAL)) or name.endswith(VISUAL_SUFFIXES):
                continue
            value = getattr(owner, name)
            if isinstance(value, (int, float, np.ndarray, np.generic)):
                digest.update(name.encode() + b"\0" + np.asarray(value).tobytes())
    return digest.hexdigest()
