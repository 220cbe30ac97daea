"""Devices of MuJoCo Warp: which there are, and how a refusal is explained."""

import dataclasses
import importlib.util
import sys
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.errors import DamagedPackageError, MissingExtraError, UnknownNameError, UsageError
from mjrun.physics import warp_device
from mjrun.physics.warp_device import UNUSED, PerWorldFields, WarpDevice
from tests.cases import mjcf

pytestmark = pytest.mark.warp


@pytest.fixture
def cpu() -> WarpDevice:
    pytest.importorskip("mujoco_warp")
    return WarpDevice("cpu")


@pytest.mark.slow
def test_a_device_that_is_not_there_is_refused_with_those_that_are(cpu: WarpDevice) -> None:
    assert (cpu.alias, cpu.is_gpu) == ("cpu", False)
    assert cpu.version.startswith("mujoco_warp ")
    with pytest.raises(UnknownNameError, match=r"no device 'cuda:99' in Warp.*\ndevices: cpu"):
        WarpDevice("cuda:99")


def test_without_the_library_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"engine warp needs mujoco-warp.*\npip install 'mjrun\[warp\]'"):
        WarpDevice()


def test_a_library_that_does_not_load_is_damaged(monkeypatch: pytest.MonkeyPatch) -> None:
    def init() -> None:
        raise RuntimeError("Failed to load the shared library 'warp.so'")

    broken = SimpleNamespace(config=SimpleNamespace(log_level=0), LOG_WARNING=1, init=init)
    monkeypatch.setitem(sys.modules, "warp", broken)
    monkeypatch.setattr(warp_device, "require_library", lambda: None)
    monkeypatch.setattr(warp_device, "version", lambda package: "1.9")
    with pytest.raises(DamagedPackageError, match=r"warp-lang 1.9 is damaged: Failed to load.*\npip install"):
        WarpDevice()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (NotImplementedError("fluids"), r"cannot simulate this model: fluids\nengine c can"),
        (RuntimeError("Failed to allocate 9 bytes"), r"^4 worlds do not fit in the memory of .*reduce worlds"),
        (ValueError("nefc > njmax"), r"nefc > njmax\nraise nconmax or njmax"),
        (TypeError("odd"), r"fails on this model: TypeError: odd\nengine c may not"),
    ],
)
def test_a_refusal_says_why_and_what_to_do(cpu: WarpDevice, error: Exception, message: str) -> None:
    with pytest.raises(UsageError, match=f"(?s){message}"), cpu.refusals(4):
        raise error


MODEL = mjcf("servo")
CHANGES = {
    "mass": lambda spec: setattr(spec.geom("g"), "mass", 3),
    "size": lambda spec: setattr(spec.geom("g"), "size", [0.2, 0.1, 0.1]),
    "friction": lambda spec: setattr(spec.geom("g"), "friction", [0.3, 0.01, 0.001]),
    "armature": lambda spec: setattr(spec.joint("j"), "armature", 0.4),
    "gain": lambda spec: setattr(spec.actuator("p"), "gainprm", [20, *[0] * 9]),
    "gravity": lambda spec: setattr(spec.option, "gravity", [0, 0, -8]),
    "wind": lambda spec: setattr(spec.option, "wind", [0, 1, 0]),
    "timestep": lambda spec: setattr(spec.option, "timestep", 0.005),
    "integrator": lambda spec: setattr(spec.option, "integrator", mujoco.mjtIntegrator.mjINT_IMPLICITFAST),
    "contype": lambda spec: setattr(spec.geom("g"), "contype", 4),
    "type": lambda spec: setattr(spec.geom("g"), "type", mujoco.mjtGeom.mjGEOM_BOX),
}
SHARED = {"mass", "size", "friction", "armature", "gravity"}


@pytest.fixture(scope="module")
def device() -> WarpDevice:
    pytest.importorskip("mujoco_warp")
    return WarpDevice("cpu")


def changed(name: str | None = None) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(MODEL)
    if name:
        CHANGES[name](spec)
    return spec.compile()


@pytest.mark.parametrize("name", CHANGES)
def test_worlds_share_a_group_where_only_their_own_numbers_differ(device: WarpDevice, name: str) -> None:
    fields = PerWorldFields(device)
    assert (fields.group(changed(name)) == fields.group(changed())) == (name in SHARED)


@pytest.mark.parametrize("name", sorted(SHARED))
def test_a_group_is_on_the_device_what_each_of_its_models_is_alone(device: WarpDevice, name: str) -> None:
    models = [changed(), changed(name)]
    with device.active():
        together = PerWorldFields(device).put_models(models[0], models)
        alone = [device.library.put_model(model) for model in models]
    for owner in ("", "opt"):
        group, *others = [getattr(each, owner) if owner else each for each in (together, *alone)]
        for field in dataclasses.fields(group):
            if field.name in UNUSED:
                continue
            value: Any = getattr(group, field.name)
            for world, other in enumerate(getattr(each, field.name) for each in others):
                if isinstance(value, (int, float, bool)):
                    assert value == other, field.name
                elif isinstance(value, device.warp.array) and value.size:
                    one, two = value.numpy(), other.numpy()
                    varies = one.shape != two.shape or getattr(field.type, "shape", "")[0] == "*"
                    one, two = (one[world % len(one)], two[0]) if varies else (one, two)
                    np.testing.assert_array_equal(one, two, err_msg=field.name)
