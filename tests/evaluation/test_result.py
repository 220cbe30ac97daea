"""The report of an evaluation is what its schema says."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from mjrun.document.report_schema import report_schema
from mjrun.evaluation.evaluation import Evaluation
from mjrun.evaluation.result import SCHEMA, EvaluationResult
from tests.document.schema_oracle import fits
from tests.evaluation.tasks import cart_task, play_here


@pytest.mark.parametrize(
    "options", [{}, {"compare": "random", "vary": {"control_dt": "0.02,0.04"}, "fail_below": {"length": 0}}]
)
def test_a_report_is_what_its_schema_says(
    tmp_path: Path, options: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    play_here(monkeypatch)
    task, schema = cart_task(tmp_path, duration=0.2), report_schema("eval", "mjrun eval", EvaluationResult)
    result = Evaluation(task, str(tmp_path / "out"), policy="zero", episodes=2, jobs=1, **options).run()  # type: ignore[arg-type]
    report = json.loads(json.dumps(asdict(result)))
    assert report["schema"] == SCHEMA
    assert fits(report, schema, schema)
    for key in report:
        assert not fits({name: value for name, value in report.items() if name != key}, schema, schema)
