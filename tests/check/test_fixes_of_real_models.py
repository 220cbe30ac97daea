"""A model that is damaged in a known way, and then fixed, compiles to the original."""

import importlib.util
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.model.mujoco_globals import collected_warnings
from tests.check.fixes import fix, lint

SCENES = Path(__file__).parents[2] / "scenes"
GYM = importlib.util.find_spec("gymnasium")
ASSETS = Path(str(GYM.origin)).parent / "envs/mujoco/assets" if GYM else Path()
MODELS = [
    SCENES / "arm.xml",
    *(ASSETS / f"{name}.xml" for name in ("half_cheetah", "humanoid")),
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


@pytest.mark.parametrize("original", MODELS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_damaged_model_is_restored(original: Path) -> None:
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
    arrays = {name: value for name in dir(expected) if isinstance(value := getattr(expected, name), np.ndarray)}
    for damage in (reversed_ranges, long_quaternions, silent_limits, outdated):
        damaged = damage(whole)
        if damaged == whole:
            continue
        path.write_text(damaged)
        fix(path.name)
        model = compiled(path)
        for name, value in arrays.items():
            if value.dtype.kind in "fiub":
                np.testing.assert_allclose(getattr(model, name), value, rtol=1e-9, atol=1e-9, err_msg=name)
        assert fix(path.name) == {}


COMPILER, JOINT = '<compiler angle="radian"', 'name="shoulder_pitch" class="large" axis="0 1 0"'
KEYFRAME, HEIGHT = 'qpos=".9 1 -.3 .7 .5 .6 1"', 'qpos="-.025 0 .7031'
OPTION = '<option integrator="implicitfast"'
UNIT = f"0 {0.707 / np.hypot(0.707, 0.7):.10f} {0.7 / np.hypot(0.707, 0.7):.10f}"
# The rule, the scene, what is replaced in it, the damage, and its repair; the latter is often what was replaced.
REPAIRS = [
    ("MJ105", "arm", OPTION, f'{OPTION} apirate="50"', OPTION),
    ("MJ108", "arm", '<key name="reach"', '<key name="home"', '<key name="home_2"'),
    ("MJ116", "arm", f"{COMPILER}/>", f'{COMPILER}/><size njmax="500" nkey="3"/>', f'{COMPILER}/><size nkey="3"/>'),
    ("MJ116", "arm", f"{COMPILER}/>", f'{COMPILER}/>\n  <size njmax="500" nconmax="9"/>', f"{COMPILER}/>"),
    ("MJ118", "arm", JOINT, JOINT.replace("0 1 0", "0 1.01 0"), JOINT),
    ("MJ118", "arm", JOINT, JOINT.replace("0 1 0", "0 .707 .7"), JOINT.replace("0 1 0", UNIT)),
    ("MJ202", "arm", COMPILER, f'{COMPILER} inertiafromgeom="false"', f'{COMPILER} inertiafromgeom="auto"'),
    ("MJ302", "arm", 'range="-1.9 1.9"', 'range="1.9 -1.9"', 'range="-1.9 1.9"'),
    ("MJ305", "arm", 'range="-1.9 1.9"', 'range="-180 180"', f'range="-{np.pi:.10g} {np.pi:.10g}"'),
    ("MJ402", "arm", KEYFRAME, KEYFRAME.replace('1"', '3.3"'), KEYFRAME.replace('1"', '3.05"')),
    ("MJ403", "arm", KEYFRAME.replace("qpos", "ctrl"), 'ctrl=".9 2.2 -.3 .7 .5 .6 1"', 'ctrl=".9 1.9 -.3 .7 .5 .6 1"'),
    ("MJ404", "humanoid", f"{HEIGHT} 1 0 0 0", f"{HEIGHT} 1.1 0 0 0", f"{HEIGHT} 1 0 0 0"),
]


def test_the_scenes_have_no_findings() -> None:
    for scene in {case[1] for case in REPAIRS}:
        text = (SCENES / f"{scene}.xml").read_text(encoding="utf-8")
        Path("model.xml").write_text(text, encoding="utf-8")
        assert not lint("model.xml", unsafe=True).result.findings


@pytest.mark.parametrize(("rule", "scene", "replaced", "damage", "repair"), REPAIRS, ids=[case[0] for case in REPAIRS])
def test_only_what_a_rule_finds_is_repaired(rule: str, scene: str, replaced: str, damage: str, repair: str) -> None:
    path, text = Path("model.xml"), (SCENES / f"{scene}.xml").read_text(encoding="utf-8")
    assert text.count(replaced) == 1
    path.write_text(text.replace(replaced, damage), encoding="utf-8")
    assert {finding.code for finding in lint(path.name, unsafe=True).result.findings} == {rule}

    assert fix(path.name, unsafe=True) == {path.name: {rule: 1}}
    assert path.read_text(encoding="utf-8") == text.replace(replaced, repair)
    if repair != replaced:
        assert not lint(path.name, unsafe=True).result.findings
