"""JSON Schema of documents, with which editors complete and check them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from mjrun.document.camera import CAMERA
from mjrun.document.evaluation import EVALUATION
from mjrun.document.fit import FIT
from mjrun.document.forms import DocumentReader
from mjrun.document.output_folder import OutputFolder
from mjrun.document.report_schema import DIALECT
from mjrun.document.run import RUN
from mjrun.document.study import STUDY
from mjrun.document.task import TASK
from mjrun.document.variables import DEFAULTS, VARS
from mjrun.errors import UnknownNameError
from mjrun.formats.format_lists import with_formats
from mjrun.options.record import Record
from mjrun.options.schema import ANNOTATIONS, Schema

JsonSchema = dict[str, Any]

# Kind of document → its contents, its title, and whether it supports variables and defaults.
DOCUMENTS: dict[str, tuple[Record[Any], str, bool]] = {
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


def json_schema(kind: str) -> JsonSchema:
    """Returns the JSON Schema, draft 2020-12, of documents of a `kind`.

    Raises:
      UnknownNameError: the kind does not exist; the message lists existing ones.
    """
    if kind not in DOCUMENTS:
        raise UnknownNameError("schema", kind, [*DOCUMENTS])
    record, title, has_variables = DOCUMENTS[kind]
    definitions: dict[str, Schema] = {}
    rule = record.mapping_schema(DocumentReader(Path(), OutputFolder(Path())), definitions)
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
