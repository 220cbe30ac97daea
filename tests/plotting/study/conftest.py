"""A sheet to draw on, and panels."""

from collections.abc import Iterator

import pytest

from mjrun.plotting.canvas import Canvas, settings
from mjrun.plotting.study.axes import Sheet
from mjrun.plotting.theme import THEMES


@pytest.fixture
def sheet() -> Iterator[Sheet]:
    with settings():
        yield Sheet(Canvas((640, 480), THEMES["light"], False), 12.0)
