"""The document that is written for a camera script is read as the same script."""

from typing import cast

import pytest
from hypothesis import given, settings

from mjrun.camera.script import CameraScript, ConditionEvent
from mjrun.document.camera_and_ghost_forms import DocumentCameraKind
from mjrun.document.run_writer import plain_value
from mjrun.document.yaml_text import yaml_text
from mjrun.options.kinds import CameraKind, ReadingContext
from mjrun.options.number_kinds import Instant
from tests.document.camera_strategies import events, scripts
from tests.document.documents import Anything, put, read


@pytest.mark.slow
@given(scripts())
@settings(max_examples=15, deadline=None)
def test_a_script_is_read_back_as_it_was(script: CameraScript) -> None:
    written = read(put(yaml_text({"a": plain_value(CameraKind(), script)})), Anything).a
    assert DocumentCameraKind().read(written, ReadingContext()) == script


@given(events)
def test_an_event_says_what_is_not_the_default(event: ConditionEvent) -> None:
    document = cast("dict[str, object]", plain_value(Instant(), event))
    assert document["when"] == event.when
    assert ("nth" in document, "offset" in document, "else" in document) == (
        event.nth != 1,
        event.offset != 0,
        event.otherwise is not None,
    )
