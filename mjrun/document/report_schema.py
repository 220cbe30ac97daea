"""JSON Schema of reports, derived from their dataclasses and the docstrings of their fields."""

import dataclasses
import inspect
import json
import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from mjrun.diff.result import DiffResult
from mjrun.errors import Failure
from mjrun.model.description.model_description import SECTION_TYPES, ModelDescription
from mjrun.model.info import InfoResult
from mjrun.outputs.run_result import RESULTS, RunResult

DIALECT = "https://json-schema.org/draft/2020-12/schema"
ERROR = "error"  # the key of a failure in any report, and the kind of a report with only that key
SECTIONED = {"info": ["warnings"], "info-task": []}  # required keys of reports that hold only the requested sections
_TYPES = {str: "string", int: "integer", float: "number", bool: "boolean", type(None): "null"}
_FIELDS = re.compile(r"^  (\w+(?:, \w+)*): (.*(?:\n    .*)*)", re.MULTILINE)

JsonSchema = dict[str, Any]


def _rule(annotation: Any, definitions: JsonSchema) -> JsonSchema:
    """Returns the rule for the values of a type."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _TYPES:
        return {"type": _TYPES[annotation]}
    if isinstance(annotation, type) and dataclasses.is_dataclass(annotation):
        name = str(annotation.__name__)
        if name not in definitions:
            definitions[name] = {}
            definitions[name] = _mapping(annotation, definitions)
        return {"$ref": f"#/$defs/{name}"}
    if origin in (Union, UnionType):
        return {"anyOf": [_rule(each, definitions) for each in arguments]}
    if origin is Literal:
        return {"enum": [*arguments], "type": "string"}
    if origin is tuple and ... not in arguments:
        items = [_rule(each, definitions) for each in arguments]
        return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}
    if origin in (list, tuple, Sequence):
        return {"type": "array", "items": _rule(arguments[0], definitions)}
    if origin in (dict, Mapping):
        return {"type": "object", "additionalProperties": _rule(arguments[1], definitions)}
    assert annotation in (object, Any), annotation
    return {}


def _mapping(report: type, definitions: JsonSchema, types: Mapping[str, Any] | None = None) -> JsonSchema:
    """Returns the rule for a dataclass, which requires all of its fields and describes them by its docstring.

    Args:
      types: the types of its properties, if these are not its fields.
    """
    if types is None:
        hints = get_type_hints(report, localns={"DiffResult": DiffResult})  # which traces import only when they need it
        types = {field.name: hints[field.name] for field in dataclasses.fields(report)}
    properties = {name: _rule(annotation, definitions) for name, annotation in types.items()}
    for cls in reversed(report.__mro__):
        _, _, fields = (inspect.getdoc(cls) or "").partition("Attributes:\n")
        for names, description in _FIELDS.findall(fields):
            for name in properties.keys() & names.split(", "):
                properties[name]["description"] = " ".join(description.split())
    about, _, _ = (inspect.getdoc(report) or "").partition("Attributes:\n")
    schema = {"title": report.__name__, "description": about.strip(), "type": "object"}
    return {**schema, "properties": properties, "required": [*properties]}


def report_schema(kind: str, command: str, report: type) -> JsonSchema:
    """Returns the JSON Schema, draft 2020-12, of the reports of a command.

    Reports may gain keys. The report of a command that fails has an `error`, and may have no other key.

    Args:
      kind: the kind of report.
      report: the dataclass of the report.
    """
    definitions: JsonSchema = {}
    schema = _info_rule(definitions) if report is InfoResult else _mapping(report, definitions)
    if report is RunResult:
        schema["properties"]["results"]["items"] |= {
            "properties": {"kind": {"description": "The kind of the output.", "enum": [*RESULTS]}},
            "required": ["kind"],
        }
    name = {"description": "The kind of this report, and the version of its schema.", "type": "string"}
    schema["properties"].setdefault("schema", name)["const"] = f"mjrun-{kind}-1"
    schema["properties"][ERROR] = _failure_rule()
    keys: list[str] = schema.pop("required")
    required = dict.fromkeys((*SECTIONED.get(kind, keys), "schema"))
    schema["anyOf"] = [{"required": [*required]}, {"required": [ERROR]}]
    return {"$schema": DIALECT, "$defs": definitions, **schema, "title": f"report of {command}"}


def _info_rule(definitions: JsonSchema) -> JsonSchema:
    """Returns the rule for a description of a model, in which null represents numbers that are not finite."""
    rule = _mapping(InfoResult, definitions, {"warnings": Sequence[str]})
    rule["properties"] = {**_mapping(ModelDescription, definitions, SECTION_TYPES)["properties"], **rule["properties"]}

    def with_null(part: JsonSchema) -> JsonSchema:
        return {**part, "type": ["number", "null"]} if part.get("type") == "number" else part

    definitions |= json.loads(json.dumps(definitions), object_hook=with_null)
    return rule


def failure_schema() -> JsonSchema:
    """Returns the JSON Schema of the report of any command that fails before it has a result."""
    return {
        "$schema": DIALECT,
        "description": "The output of a command with --json when it fails.",
        "type": "object",
        "properties": {ERROR: _failure_rule()},
        "required": [ERROR],
        "title": "report of a failure",
    }


def _failure_rule() -> JsonSchema:
    schema = _mapping(Failure, {})
    del schema["properties"]["facts"]
    schema["required"].remove("facts")
    return schema
