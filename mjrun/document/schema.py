"""JSON Schema of the documents, by which editors complete and check them while they are written."""

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from mjrun.document.camera import Document
from mjrun.document.preamble import DEFAULTS, VARS
from mjrun.errors import UnknownNameError

# Kind of document → its form, its title, and whether it may have a preamble.
KINDS: dict[str, tuple[type[BaseModel], str, bool]] = {
    "camera": (Document, "mjrun camera document", False),
}
PREAMBLE = {
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


class _Generator(GenerateJsonSchema):
    """Leaves out what pydantic makes up: titles of fields, and the null of what may be left out."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def default_schema(self, schema: Any) -> JsonSchemaValue:
        if schema.get("default") is None:
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)


def schema(kind: str) -> dict[str, Any]:
    """The JSON Schema, draft 2020-12, of documents of a `kind`.

    Raises:
      UnknownNameError: there is no such kind; the message lists those there are.
    """
    if kind not in KINDS:
        raise UnknownNameError("schema", kind, list(KINDS))
    form, title, preamble = KINDS[kind]
    made = form.model_json_schema(schema_generator=_Generator)
    made = {"$schema": _Generator.schema_dialect, **made, "title": title}
    if preamble:
        made["properties"] = {**PREAMBLE, **made["properties"]}
    return made
