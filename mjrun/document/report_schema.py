"""JSON Schema of what mjrun reports, derived from its dataclasses and what their docstrings say of each field."""

import inspect
import re

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import DataclassField, DataclassSchema, ModelField, TypedDictField, WithDefaultSchema

from mjrun.bench.results import BenchResult
from mjrun.diff.result import DiffResult
from mjrun.document.schema_kinds import ERROR
from mjrun.document.schema_kinds import REPORTS as COMMANDS
from mjrun.errors import Failure
from mjrun.evaluation.result import EvaluationResult
from mjrun.fit.excitation import ExcitationResult
from mjrun.fit.result import FitResult
from mjrun.plotting.table_plot import TablePlotResult
from mjrun.simulation.verification import VerificationResult
from mjrun.study.study import StudyResult
from mjrun.viewer.viewer import ViewerResult

# Kind of report, such as `bench` of the schema `mjrun-bench-1` → its dataclass.
REPORTS = {
    report.schema.split("-")[1]: report
    for report in (
        BenchResult,
        DiffResult,
        EvaluationResult,
        ExcitationResult,
        FitResult,
        TablePlotResult,
        StudyResult,
        VerificationResult,
        ViewerResult,
    )
}
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
        about, _, fields = (inspect.getdoc(schema["cls"]) or "").partition("Attributes:\n")
        report["description"] = about.strip()
        for names, description in _FIELDS.findall(fields):
            for name in names.split(", "):
                report["properties"][name]["description"] = " ".join(description.split())
        return report


def report_schema(kind: str) -> JsonSchemaValue:
    """The JSON Schema, draft 2020-12, of reports of a `kind`, one of `REPORTS`, or of `error`, a failure alone.

    New keys may come to a report. One of a command that fails has an `error`, and may have nothing else.
    """
    failure = {ERROR: _failure_schema()}
    if kind == ERROR:
        schema = {"description": "What a command with --json prints when it fails.", "type": "object"}
        return {
            "$schema": _Generator.schema_dialect,
            **schema,
            "properties": failure,
            "required": [ERROR],
            "title": "report of a failure",
        }
    report = REPORTS[kind]
    schema = TypeAdapter(report).json_schema(schema_generator=_Generator, mode="serialization")
    schema["properties"]["schema"]["const"] = report.schema
    schema["properties"] |= failure
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": [ERROR]}]
    return {"$schema": _Generator.schema_dialect, **schema, "title": f"report of {COMMANDS[kind]}"}


def _failure_schema() -> JsonSchemaValue:
    schema = TypeAdapter(Failure).json_schema(schema_generator=_Generator, mode="serialization")
    for key in ("properties", "required"):
        schema[key].pop("facts" if key == "properties" else schema[key].index("facts"))
    return schema
