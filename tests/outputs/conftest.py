"""What tests of outputs share: each backend is tried once, since no test here is about how it is detected."""

import os
from collections.abc import Sequence
from typing import Any

import pytest

from mjrun.rendering import backend as backend_module
from mjrun.rendering.backend import BackendTrialProcess

ANSWERS: dict[object, dict[str, Any]] = {}  # of backends, by all that decides them


class RememberedTrial(BackendTrialProcess):
    """A trial whose process is started only if the same was never tried in this environment."""

    def __init__(self, name: str, draw: bool = False, device: int | None = None, unset: Sequence[str] = ()) -> None:
        self.name = name
        environment = {variable: value for variable, value in os.environ.items() if variable != "PYTEST_CURRENT_TEST"}
        self._key = (name, draw, device, *unset, *sorted(environment.items()))
        self._is_new = self._key not in ANSWERS
        if self._is_new:
            super().__init__(name, draw, device, unset)

    def answer(self) -> dict[str, Any]:
        if self._is_new:
            ANSWERS[self._key] = super().answer()
        return ANSWERS[self._key]

    def cancel(self) -> None:
        if self._is_new:
            super().cancel()


@pytest.fixture(autouse=True)
def backends_are_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend_module, "BackendTrialProcess", RememberedTrial)
