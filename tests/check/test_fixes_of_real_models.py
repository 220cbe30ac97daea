"""A model that is damaged in a known way, and then fixed, compiles to the original."""

import importlib.util
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.model.mujoco_globals import collected_warnings
from tests.check.fixes import fix

SCENES = Path(__file__).parents[2] / "scenes"
GYM = importlib.util.find_spec("gymnasium")
ASSETS = Path(str(GYM.origin)).parent / "envs/mujoco/assets" if GYM else Path()
MODELS = [
    *(SCENES / f"{name}.xml" for name in ("arm", "humanoid")),
    *(ASSETS / f"{name}.xml" for name in ("half_cheetah", "humanoid", "reacher")),
]
NUMBER = r"[-+.\deE]+"
RANGE = re.compile(rf'(\s(?:range|ctrlrange|forcerange)=["\'])\s*({NUMBER})(\s+)({NUMBER})\s*(["\'])')
QUATERNION = re.compile(rf'(\squat=")({NUMBER}) ({NUMBER}) ({NUMBER}) ({NUMBER})(")')


def reversed_ranges(text: str) -> str:
    return RANGE.sub(r"\1\4\3\2\5", text)


def long_quaternions(text: str) -> str:
    def longer(match: re.Match[str]) -> str:
        numbers = np.array(list(map(float, match.groups()[1:5])))
        scaled = 1.01 * numbers / np.linalg.norm(numbers)
        return match[1] + " ".join(map(repr, scaled.tolist())) + match[6]

    return QUATERNION.sub(longer, text)


def silent_limits(text: str) -> str:
    text = re.sub(r'\s(?:ctrl|force)?limited="true"', "", text)
    return re.sub(r"(<mujoco[^>]*>)", r'\1<compiler autolimits="false"/>', text, count=1)


def outdated(text: str) -> str:
    old = '<option apirate="50" collision="all"><flag passive="enable" sensornoise="disable"/></option>'
    return re.sub(r"(<mujoco[^>]*>)", rf'\1{old}<compiler convexhull="true"/>', text, count=1)


def compiled(path: Path) -> mujoco.MjModel:
    with collected_warnings():
        return mujoco.MjModel.from_xml_path(str(path))


@pytest.mark.parametrize("damage", [reversed_ranges, long_quaternions, silent_limits, outdated])
@pytest.mark.parametrize("original", MODELS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_damaged_model_is_restored(original: Path, damage: Callable[[str], str]) -> None:
    if not original.exists():
        pytest.skip("gymnasium is not installed")
    text = original.read_text()
    for folder in ("meshes", "textures"):
        if (original.parent / folder).is_dir():
            shutil.copytree(original.parent / folder, folder)
    path = Path(original.name)
    path.write_text(text)
    fix(path.name)  # faults of its own
    whole, expected = path.read_text(), compiled(path)
    path.write_text(damage(whole))
    if damage(whole) == whole:
        return
    fix(path.name)

    model = compiled(path)
    for name in dir(expected):
        value = getattr(expected, name)
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            np.testing.assert_allclose(getattr(model, name), value, rtol=1e-12, atol=1e-12, err_msg=name)
    assert fix(path.name) == {}
