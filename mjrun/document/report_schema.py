"""JSON Schema of what mjrun reports, derived from its dataclasses and what their docstrings say of each field."""

import inspect
import re

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import DataclassField, DataclassSchema, ModelField, TypedDictField, WithDefaultSchema

from mjrun.diff.result import DiffResult
from mjrun.errors import Failure
from mjrun.outputs.run_result import RESULTS, RunResult

ERROR = "error"  # the key of a failure in any report, and the kind of a report of nothing else
_FIELDS = re.compile(r"^  (\w+(?:, \w+)*): (.*(?:\n    .*)*)", re.MULTILINE)


class _Generator(GenerateJsonSchema):
    """Describes each field; a report has all of them."""

    def field_title_should_be_set(self, schema: object) -> bool:
        return False

    def field_is_required(self, field: ModelField | DataclassField | TypedDictField, total: bool) -> bool:
        return True

    def default_schema(self, schema: WithDefaultSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def dataclass_schema(self, schema: DataclassSchema) -> JsonSchemaValue:
        report = super().dataclass_schema(schema)
        about, _, _ = (inspect.getdoc(schema["cls"]) or "").partition("Attributes:\n")
        report["description"] = about.strip()
        for cls in reversed(schema["cls"].__mro__):
            _, _, fields = (inspect.getdoc(cls) or "").partition("Attributes:\n")
            for names, description in _FIELDS.findall(fields):
                for name in names.split(", "):
                    report["properties"][name]["description"] = " ".join(description.split())
        return report


def report_schema(kind: str, command: str, report: type) -> JsonSchemaValue:
    """Returns the JSON Schema, draft 2020-12, of the reports of a command.

    New keys may come to a report. One of a command that fails has an `error`, and may have nothing else.

    Args:
      kind: of the report.
      report: its dataclass.
    """
    adapter: TypeAdapter[object] = TypeAdapter(report)
    adapter.rebuild(_types_namespace={"DiffResult": DiffResult})  # which traces import only when they need it
    schema = adapter.json_schema(schema_generator=_Generator, mode="serialization")
    if report is RunResult:
        schema["properties"]["results"]["items"] |= {
            "properties": {"kind": {"description": "The kind of the output.", "enum": [*RESULTS]}},
            "required": ["kind"],
        }
    name = {"description": "The kind of this report, and the version of its schema.", "type": "string"}
    schema["properties"].setdefault("schema", name)["const"] = f"mjrun-{kind}-1"
    schema["properties"][ERROR] = _failure_rule()
    schema["anyOf"] = [{"required": [*dict.fromkeys((*schema.pop("required"), "schema"))]}, {"required": [ERROR]}]
    return {"$schema": _Generator.schema_dialect, **schema, "title": f"report of {command}"}


def failure_schema() -> JsonSchemaValue:
    """Returns the JSON Schema of what any command reports when it fails before it has a result."""
    return {
        "$schema": _Generator.schema_dialect,
        "description": "What a command with --json prints when it fails.",
        "type": "object",
        "properties": {ERROR: _failure_rule()},
        "required": [ERROR],
        "title": "report of a failure",
    }


def _failure_rule() -> JsonSchemaValue:
    schema = TypeAdapter(Failure).json_schema(schema_generator=_Generator, mode="serialization")
    for key in ("properties", "required"):
        schema[key].pop("facts" if key == "properties" else schema[key].index("facts"))
    return schema
