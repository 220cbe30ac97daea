"""The report of a fit is what its schema says."""

from mjrun.document.report_schema import report_schema
from mjrun.fit.result import FitResult


def test_every_field_of_a_report_is_described() -> None:
    properties = report_schema("fit", "mjrun fit", FitResult)["properties"]
    assert set(properties) == {*FitResult.__dataclass_fields__, "error"}
    assert all(each.get("description") or name == "schema" for name, each in properties.items())
