"""Small documents and their models, for the tests of reading."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, Field

from mjrun.document.document_model import DocumentModel, Name, Omittable, Positive
from mjrun.errors import DocumentError, FileError

ANCHOR = "anchors (&) and aliases (*) are not taken; text that begins so goes in quotes"


class Anything(BaseModel):
    """A document that says one thing, whatever it is."""

    a: Any


class Film(DocumentModel):
    """A part of a document."""

    fps: Positive = 60.0
    """Frames per second."""
    title: Omittable[str] = None
    """A text."""


class Run(DocumentModel):
    """A document as the ones to come will be."""

    duration: Positive = 1.0
    """How long [s]."""
    steps: Omittable[int] = None
    """How many."""
    model: Name = "m.xml"
    """A file."""
    films: list[Film] = Field([])
    """Films."""
    start: dict[str, float] = Field({})
    """Numbers by name."""


def put(text: str | bytes, name: str = "d.yaml") -> Path:
    path = Path(name)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def problems(action: Callable[[], object]) -> list[str]:
    """The lines of the error that `action` ends in."""
    with pytest.raises(DocumentError) as caught:
        action()
    return str(caught.value).splitlines()


def outcome(action: Callable[[], object]) -> object:
    """What `action` gives, or the error that it may end in."""
    try:
        return action()
    except (DocumentError, FileError) as error:
        return error
