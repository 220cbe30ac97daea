"""The document that is written for a camera script is read as the same script."""

import dataclasses
from pathlib import Path
from typing import cast

import pytest
from hypothesis import given, settings

from mjrun.camera.script import CameraScript, Event
from mjrun.document.camera_writer import camera_document, event_document
from mjrun.document.inline_values import InlineCamera
from mjrun.document.reader import read
from mjrun.document.yaml_writer import yaml_text
from tests.document.camera_strategies import events, scripts


def plain(value: object) -> object:
    """`value` with lists for tuples, so that sequences are equal whatever holds them."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return type(value).__name__, {
            field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
    return [plain(item) for item in cast("list[object]", value)] if isinstance(value, list | tuple) else value


@pytest.mark.slow
@given(scripts())
@settings(max_examples=200, deadline=None)
def test_a_script_is_read_back_as_it_was(script: CameraScript) -> None:
    Path("c.yaml").write_text(yaml_text(camera_document(script)), encoding="utf-8")
    document = read("c.yaml", InlineCamera)
    assert plain(document.script(document.name)) == plain(script)


@given(events)
def test_an_event_says_what_is_not_the_default(event: Event) -> None:
    document = event_document(event, "time")
    assert document["when"] == event.when
    assert ("nth" in document, "offset" in document, "else" in document) == (
        event.nth != 1,
        event.offset != 0,
        event.otherwise is not None,
    )
