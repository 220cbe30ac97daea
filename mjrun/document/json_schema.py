"""JSON Schema of documents, with which editors complete and check them, and of reports with --json."""

import dataclasses
import inspect
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from mjrun.diff.result import DiffResult
from mjrun.document.builder import DocumentContext
from mjrun.document.camera_and_ghost_forms import CAMERA
from mjrun.document.evaluation import EVALUATION
from mjrun.document.fit import FIT
from mjrun.document.reader import DEFAULTS, VARS
from mjrun.document.run import RUN
from mjrun.document.study import STUDY
from mjrun.document.task import TASK
from mjrun.errors import FailureReport, UnknownNameError
from mjrun.model.info import SECTION_TYPES, InfoResult, ModelDescription
from mjrun.options.schema_validation import ANNOTATIONS, Schema
from mjrun.options.structured_kinds import OptionsMappingKind
from mjrun.outputs.format_lists import with_formats
from mjrun.outputs.run_report import RESULTS, RunResult

DIALECT = "https://json-schema.org/draft/2020-12/schema"
ERROR = "error"  # the key of a failure in any report, and the kind of a report with only that key
SECTIONED = {"info": ["warnings"], "info-task": []}  # required keys of reports that hold only the requested sections
_TYPES = {str: "string", int: "integer", float: "number", bool: "boolean", type(None): "null"}
_FIELDS = re.compile(r"^  (\w+(?:, \w+)*): (.*(?:\n    .*)*)", re.MULTILINE)

JsonSchema = dict[str, Any]

# Kind of document → its contents, its title, and whether it supports variables and defaults.
DOCUMENTS: dict[str, tuple[OptionsMappingKind[Any], str, bool]] = {
    "camera": (CAMERA, "mjrun camera document", False),
    "run": (RUN, "mjrun run document", True),
    "study": (STUDY.record, "mjrun study document", True),
    "fit-document": (FIT.record, "mjrun fit document", True),
    "eval-document": (EVALUATION, "mjrun eval document", True),
    "task": (TASK, "mjrun task document", True),
}
VARIABLE_KEYS = {
    VARS: {
        "description": "Values under names of letters, digits and _; ${name} in a text inserts one.",
        "type": "object",
        "propertyNames": {"pattern": "^[A-Za-z_][A-Za-z0-9_]*$"},
        "additionalProperties": {"type": ["string", "number", "boolean", "null"]},
    },
    DEFAULTS: {
        "description": "Another document, relative to the folder of this one, with values for missing keys.",
        "type": "string",
    },
}
VARIABLE = {
    "description": "The value of a variable.",
    "type": "string",
    "pattern": r"^\$\{[A-Za-z_][A-Za-z0-9_]*\}$",
}
NOTES = ("description", "default")  # keywords that do not affect validation
NARROW = ("enum", "const", "pattern")  # keywords that reject a text with a variable


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
    schema = _mapping(FailureReport, {})
    del schema["properties"]["facts"]
    schema["required"].remove("facts")
    return schema


def json_schema(kind: str) -> JsonSchema:
    """Returns the JSON Schema, draft 2020-12, of documents of a `kind`.

    Raises:
      UnknownNameError: the kind does not exist; the message lists existing ones.
    """
    if kind not in DOCUMENTS:
        raise UnknownNameError("schema", kind, [*DOCUMENTS])
    record, title, has_variables = DOCUMENTS[kind]
    definitions: dict[str, Schema] = {}
    rule = record.mapping_schema(DocumentContext(Path()), definitions)
    schema: JsonSchema = printed({"$schema": DIALECT, "$defs": definitions, **rule, "title": title})
    return _with_variable_keys(schema) if has_variables else schema


def printed(rule: Any) -> Any:
    """Returns `rule` without the annotations for messages, with the available formats in descriptions."""
    if isinstance(rule, list | tuple):
        return [printed(part) for part in cast("Sequence[object]", rule)]
    if not isinstance(rule, dict):
        return rule
    parts = cast("dict[str, object]", rule)
    whole = {key: printed(part) for key, part in parts.items() if key not in ANNOTATIONS or isinstance(part, dict)}
    if isinstance(about := whole.get("description"), str):
        whole["description"] = with_formats(about)
    return whole


def _with_variable_keys(schema: JsonSchema) -> JsonSchema:
    """Extends `schema` for a document with variables and with defaults from another document."""
    properties = {key: _with_variables(rule) for key, rule in schema["properties"].items()}
    definitions = {name: _with_variables(rule) for name, rule in schema.get("$defs", {}).items()}
    without_defaults = {key: schema[key] for key in ("required", "anyOf") if key in schema}
    rest = {key: value for key, value in schema.items() if key != "required"}
    return {
        **rest,
        "$defs": {**definitions, "Variable": VARIABLE},
        "properties": {**VARIABLE_KEYS, **properties},
        "anyOf": [{"required": [DEFAULTS]}, without_defaults],
    }


def _with_variables(rule: object) -> object:
    """Extends the rules in `rule` by variables wherever a value is not free text."""
    if isinstance(rule, list):
        return [_with_variables(inner) for inner in cast("list[object]", rule)]
    return _rule_with_variables(cast("JsonSchema", rule)) if isinstance(rule, dict) else rule


def _rule_with_variables(rule: JsonSchema) -> JsonSchema:
    if rule.get("type") in ("number", "integer", "boolean") or any(key in rule for key in NARROW):
        notes = {key: rule[key] for key in NOTES if key in rule}
        bare = {key: value for key, value in rule.items() if key not in notes}
        return {**notes, "anyOf": [bare, {"$ref": "#/$defs/Variable"}]}
    return {key: value if key in NOTES else _with_variables(value) for key, value in rule.items()}
