"""`mjrun schema` as a user runs it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from mjrun.cli.schema import KINDS
from mjrun.document.json_schema import json_schema

if TYPE_CHECKING:
    from tests.conftest import Command


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "options"])
def test_each_kind_is_the_schema_of_the_library_as_json(mjrun_here: Command, kind: str) -> None:
    done = mjrun_here("schema", kind)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(done.stdout) == json.loads(json.dumps(json_schema(kind)))


def test_options_are_a_reference_in_markdown(mjrun_here: Command) -> None:
    done = mjrun_here("schema", "options")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"# Options of mjrun\n")


def test_another_kind_is_refused_with_those_there_are(mjrun_here: Command) -> None:
    done = mjrun_here("schema", "film")
    assert (done.returncode, done.stdout) == (2, b"")
    assert all(f"'{kind}'".encode() in done.stderr for kind in KINDS)
