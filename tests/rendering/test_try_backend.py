"""The script that tries a backend, on the drivers of this machine and on broken ones."""

import sys
from pathlib import Path

import pytest

from mjrun.rendering import backend_detection
from mjrun.rendering.backend import Backend
from mjrun.rendering.backend_detection import BackendTrialProcess


def test_a_driver_that_crashes_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    assert BackendTrialProcess("egl").result() == "its process ended with code 1"


def test_a_driver_that_crashes_has_the_last_word(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    crash = tmp_path / "crash"
    crash.write_text("#!/bin/sh\necho noise\necho one >&2\necho 'reason: no device' >&2\nexit 3\n")
    crash.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crash))
    assert BackendTrialProcess("vulkan").result() == "its process ended with code 3 (reason: no device)"


def test_a_driver_that_hangs_is_an_answer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    hang = tmp_path / "hang"
    hang.write_text("#!/bin/sh\nexec sleep 60\n")
    hang.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(hang))
    monkeypatch.setattr(backend_detection, "TIMEOUT", 0.1)
    assert BackendTrialProcess("egl").result() == "did not answer within 0.1 s"


def test_a_backend_that_draws_is_seen_to_and_one_that_draws_nothing_is_refused(
    backend: Backend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert BackendTrialProcess(backend.name, draw=True).result() == backend
    script = Path(backend_detection.__file__).with_name("try_backend.py").read_text()
    blind = tmp_path / "try_backend.py"
    blind.write_text(script.replace("mujoco.mjr_render(rect, scene, context)", "pass"))
    monkeypatch.setattr(backend_detection, "__file__", str(tmp_path / "backend_detection.py"))
    assert BackendTrialProcess(backend.name, draw=True).result() == f"{backend.renderer} draws wrongly"
    assert BackendTrialProcess(backend.name).result() == backend


def test_egl_tells_its_devices(backend: Backend) -> None:
    devices = BackendTrialProcess("devices").answer()["devices"]
    assert [device["index"] for device in devices] == list(range(len(devices)))
    assert all(set(device) == {"index", "cuda", "file"} for device in devices)
    assert devices or backend.name != "egl"
