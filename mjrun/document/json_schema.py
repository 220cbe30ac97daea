"""JSON Schema of the documents, by which editors complete and check them while they are written."""

from typing import cast

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import WithDefaultSchema

from mjrun.document.camera import CameraDocument
from mjrun.document.evaluation import EvaluationDocument
from mjrun.document.fit import FitDocument
from mjrun.document.run import RunDocument
from mjrun.document.study import StudyDocument
from mjrun.document.task import TaskDocument
from mjrun.document.variables import DEFAULTS, VARS
from mjrun.errors import UnknownNameError

# Kind of document → its model, its title, and whether it may have variables and defaults.
DOCUMENTS: dict[str, tuple[type[BaseModel], str, bool]] = {
    "camera": (CameraDocument, "mjrun camera document", False),
    "run": (RunDocument, "mjrun run document", True),
    "study": (StudyDocument, "mjrun study document", True),
    "fit-document": (FitDocument, "mjrun fit document", True),
    "eval-document": (EvaluationDocument, "mjrun eval document", True),
    "task": (TaskDocument, "mjrun task document", True),
}
VARIABLE_KEYS = {
    VARS: {
        "description": "Values under names of letters, digits and _; ${name} in a text stands for one.",
        "type": "object",
        "propertyNames": {"pattern": "^[A-Za-z_][A-Za-z0-9_]*$"},
        "additionalProperties": {"type": ["string", "number", "boolean", "null"]},
    },
    DEFAULTS: {
        "description": "Another document, relative to the folder of this one, whose values count where this has none.",
        "type": "string",
    },
}
VARIABLE = {
    "description": "The value of one of vars.",
    "type": "string",
    "pattern": r"^\$\{[A-Za-z_][A-Za-z0-9_]*\}$",
}
ANNOTATIONS = ("description", "default")  # keywords beside those that say what is valid
NARROW = ("enum", "const", "pattern")  # keywords that a text with a variable does not fit


class _Generator(GenerateJsonSchema):
    """Leaves out what pydantic makes up: titles of fields, and the null of what may be left out."""

    def field_title_should_be_set(self, schema: object) -> bool:
        return False

    def default_schema(self, schema: WithDefaultSchema) -> JsonSchemaValue:
        if schema.get("default") is None:
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)


def json_schema(kind: str) -> JsonSchemaValue:
    """Returns the JSON Schema, draft 2020-12, of documents of a `kind`.

    Raises:
      UnknownNameError: there is no such kind; the message lists those there are.
    """
    if kind not in DOCUMENTS:
        raise UnknownNameError("schema", kind, [*DOCUMENTS])
    model, title, has_variables = DOCUMENTS[kind]
    schema = model.model_json_schema(schema_generator=_Generator)
    schema = {"$schema": _Generator.schema_dialect, **schema, "title": title}
    return _with_variable_keys(schema) if has_variables else schema


def _with_variable_keys(schema: JsonSchemaValue) -> JsonSchemaValue:
    """`schema` for a document that may have variables, and defaults that say what it does not."""
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
    """`rule`, or the rules in it, with variables wherever a value is no free text."""
    if isinstance(rule, list):
        return [_with_variables(inner) for inner in cast("list[object]", rule)]
    return _rule_with_variables(cast("JsonSchemaValue", rule)) if isinstance(rule, dict) else rule


def _rule_with_variables(rule: JsonSchemaValue) -> JsonSchemaValue:
    if rule.get("type") in ("number", "integer", "boolean") or any(key in rule for key in NARROW):
        annotations = {key: rule[key] for key in ANNOTATIONS if key in rule}
        bare = {key: value for key, value in rule.items() if key not in annotations}
        return {**annotations, "anyOf": [bare, {"$ref": "#/$defs/Variable"}]}
    changed: JsonSchemaValue = {
        key: value if key in ANNOTATIONS else _with_variables(value) for key, value in rule.items()
    }
    if all("required" not in member for member in changed.get("oneOf", [{"required": []}])):
        changed["anyOf"] = changed.pop("oneOf")  # a variable may fit several
    return changed
