"""What decides how a model moves and what is measured of it, as a fingerprint."""

import hashlib

import mujoco
import numpy as np

# Arrays of MjModel that only pictures, starts and names are made of, and how many of them there are.
LOOKS = ("cam_", "key_", "light_", "mat_", "name_", "names", "paths", "skin_", "tex_", "text_")
LOOKS += ("nbuffer", "ncam", "nkey", "nlight", "nmat", "nnames", "npaths", "nskin", "ntex", "signature")
LOOKS_OF_PARTS = ("_rgba", "_group", "_matid", "_texcoord", "_texcoordadr", "_texcoordnum")


def fingerprint(model: mujoco.MjModel) -> str:
    """SHA-256 of the options and of every array that is not about looks, keyframes or names."""
    digest = hashlib.sha256()
    for owner in (model, model.opt):
        for name in sorted(dir(owner)):
            if name.startswith(("_", *LOOKS)) or name.endswith(LOOKS_OF_PARTS):
                continue
            value = getattr(owner, name)
            if isinstance(value, (int, float, np.ndarray, np.generic)):
                digest.update(name.encode() + b"\0" + np.asarray(value).tobytes())
    return digest.hexdigest()
