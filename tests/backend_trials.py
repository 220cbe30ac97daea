"""Trials of backends whose results are kept, since hardly any test is about how a backend is detected."""

import os
from collections.abc import Sequence
from typing import Any

from mjrun.rendering.backend import GL, BackendTrialProcess

WITHOUT_EFFECT = ("PYTEST_CURRENT_TEST", GL)  # on a trial, which sets the latter itself
OF_ONE_BACKEND = {"MUJOCO_EGL_DEVICE_ID": "egl", "VK_ICD_FILENAMES": "vulkan", "VK_DRIVER_FILES": "vulkan"}
NOTHING_IF_EMPTY = ("DISPLAY", "LD_PRELOAD", "WAYLAND_DISPLAY")
ANSWERS: dict[object, dict[str, Any]] = {}  # of backends, by all that decides them


class RememberedTrial(BackendTrialProcess):
    """A trial whose process is started only if the same was never tried in this environment."""

    def __init__(
        self, name: str, draw: bool = False, device: int | None = None, unset: Sequence[str] = (), is_fork: bool = False
    ) -> None:
        self.name = name
        environment = {
            variable: value
            for variable, value in os.environ.items()
            if variable not in WITHOUT_EFFECT
            and OF_ONE_BACKEND.get(variable, name) == name
            and (value or variable not in NOTHING_IF_EMPTY)
        }
        self._key = (name, draw, device, *unset, *sorted(environment.items()))
        self._is_new = self._key not in ANSWERS
        if self._is_new:
            super().__init__(name, draw, device, unset, is_fork)

    def answer(self) -> dict[str, Any]:
        if self._is_new:
            ANSWERS[self._key] = super().answer()
            self._is_new = False
        return ANSWERS[self._key]

    def cancel(self) -> None:
        if self._is_new:
            super().cancel()
