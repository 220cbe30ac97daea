"""The kinds that can be asked for are those that have a schema."""

from mjrun.document import json_schema, report_schema
from mjrun.document.schema_kinds import DOCUMENTS, REPORTS


def test_every_kind_of_document_and_of_report_has_a_schema_and_can_be_asked_for() -> None:
    assert {*DOCUMENTS} == {*json_schema.DOCUMENTS}
    assert [*REPORTS] == [*report_schema.REPORTS]
    assert not {*DOCUMENTS} & {*REPORTS}
