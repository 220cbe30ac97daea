"""Devices of MuJoCo Warp: which there are, and how a refusal is explained."""

import importlib.util

import pytest

from mjrun.errors import MissingExtraError, UnknownNameError, UsageError
from mjrun.physics.warp_device import WarpDevice


@pytest.fixture
def cpu() -> WarpDevice:
    pytest.importorskip("mujoco_warp")
    return WarpDevice("cpu")


def test_a_device_that_is_not_there_is_refused_with_those_that_are(cpu: WarpDevice) -> None:
    assert (cpu.alias, cpu.is_gpu) == ("cpu", False)
    assert cpu.version.startswith("mujoco_warp ")
    with pytest.raises(UnknownNameError, match=r"no device 'cuda:99' in Warp.*\ndevices: cpu"):
        WarpDevice("cuda:99")


def test_without_the_library_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"engine warp needs mujoco-warp.*\npip install 'mjrun\[warp\]'"):
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
