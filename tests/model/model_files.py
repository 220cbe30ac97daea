"""A small model, and files of it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import ModelError
from mjrun.model.sources import load

MODEL = """<mujoco>
  <worldbody>
    <body name="ball"><freejoint/><geom name="skin" size=".1"/></body>
  </worldbody>
</mujoco>"""


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def content(model: mujoco.MjModel) -> bytes:
    """The whole compiled model."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def compiled(path: Path, text: str = MODEL) -> Path:
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(text), str(path))
    return path


def refusal(path: Path) -> ModelError:
    """The error of loading a model."""
    with pytest.raises(ModelError) as caught:
        load(path)
    assert caught.value.exit_code == 3
    return caught.value
