"""The reference of options is complete, right about documents and Python, and the file at the top is current."""

import re
from pathlib import Path
from typing import Any

import click
import pytest

import mjrun
from mjrun.cli.main import COMMANDS, group
from mjrun.cli.options_reference import RUN, TASK, TOP_LEVEL, options_reference, reference_sections
from mjrun.document.json_schema import json_schema
from mjrun.formats.tables import suffixes
from mjrun.options.option import FrontEnd, Options, options_of
from mjrun.options.task import PARTS
from mjrun.probe.expression import FUNCTIONS, SUCCESSIVE
from tests.cases import cases

ROOT = Path(__file__).parents[2]
SECTIONS = reference_sections()
ROWS = [(section, each, section.owners[each.name]) for section in SECTIONS for each in section.options.values()]


def test_the_file_at_the_top_is_what_the_command_prints_now() -> None:
    current = options_reference() + "\n"
    assert (ROOT / "REFERENCE.md").read_text("utf-8") == current, "make it anew: mjrun schema options > REFERENCE.md"
    assert "(REFERENCE.md)" in (ROOT / "README.md").read_text("utf-8")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_of_every_command_is_there(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command
    listed = {each.name for _, each, owners in ROWS if name in {owner.command for owner in owners}}
    assert listed == {param.name for param in command.params if isinstance(param, click.Option)}


def test_keys_are_those_of_the_schema_of_run_documents() -> None:
    definitions = json_schema("run")
    for section, each, owners in ROWS:
        for key in {owner.key for owner in owners if owner.documents == RUN} - {""}:
            keys = _keys(definitions, key)
            assert (each.name in keys) == (FrontEnd.DOCUMENT in each.places), (section.title, key, each.name)


def test_every_key_of_run_documents_is_there() -> None:
    definitions = json_schema("run")
    outputs = ("videos", "images", "traces", "plots", "exports", "recordings", "keyframes")
    for key in (TOP_LEVEL, *outputs):
        listed = {each.name for _, each, owners in ROWS if key in {owner.key for owner in owners}}
        assert _keys(definitions, key) - {"model", "vars", "defaults", *outputs} <= listed


def test_the_keys_of_task_documents_are_those_of_their_schema() -> None:
    definitions = json_schema("task")
    properties: dict[str, Any] = definitions["properties"]
    listed: dict[str, set[str]] = {}
    for _, each, owners in ROWS:
        for owner in owners:
            if owner.documents == TASK:
                listed.setdefault(owner.key, set()).add(each.key)
    assert listed.pop(TOP_LEVEL) == {*properties} - {"model", "vars", "defaults", *PARTS}
    assert listed == {
        key + entry: {*definitions["$defs"][declared.section]["properties"]} for key, (entry, declared) in PARTS.items()
    }


def test_python_arguments_are_those_of_the_classes() -> None:
    for section, each, owners in ROWS:
        for name in {owner.python for owner in owners} - {""}:
            cls = getattr(mjrun, name)
            assert issubclass(cls, Options)
            attributes = {option.attribute for option in options_of(cls)}
            assert (each.attribute in attributes) or FrontEnd.PYTHON not in each.places, (
                section.title,
                name,
                each.name,
            )


def test_every_function_of_expressions_is_there() -> None:
    _, _, functions = options_reference().partition("## Functions in expressions")
    named = {word for line in functions.splitlines() for word in re.findall(r"[a-z]+", line.partition("(")[0])}
    assert {*FUNCTIONS, *SUCCESSIVE} <= named


def test_every_suffix_of_tables_is_there_with_the_extra_that_it_needs() -> None:
    text = options_reference().partition("## Table formats")[2].partition("\n## ")[0]
    rows = {row.split(" | ")[1]: row for row in text.splitlines() if row.startswith("| ")}
    assert [suffix.strip("`") for listed in list(rows)[1:] for suffix in listed.split()] == suffixes()
    assert "mjrun[parquet]" in rows["`.feather` `.arrow`"]
    assert "mjrun[" not in rows["`.jsonl`"]


def test_every_row_of_an_option_has_three_cells_and_no_placeholder_is_left() -> None:
    text = options_reference().partition("## Table formats")[0]
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert all(len(re.split(r"(?<!\\)\|", row)) == 5 for row in rows)
    assert "formats}" not in text


@cases("name, end")
def test_a_row_states_the_default_and_where_its_option_is_missing_or_spelled_otherwise(name: str, end: str) -> None:
    row = next(line for line in options_reference().splitlines() if line.startswith(f"| {name} |"))
    assert row.removesuffix(" |").endswith(end)


def _keys(definitions: dict[str, object], key: str) -> set[str]:
    """The keys of entries of the list `key` in run documents, or of the document itself."""
    properties = definitions["properties"]
    assert isinstance(properties, dict)
    if key == TOP_LEVEL:
        return set(properties)
    entry = next(each for each in properties[key]["items"]["anyOf"] if "$ref" in each)
    home = definitions["$defs"]
    assert isinstance(home, dict)
    return set(home[entry["$ref"].rpartition("/")[2]]["properties"])
