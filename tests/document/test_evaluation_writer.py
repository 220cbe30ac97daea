"""From evaluations to documents; that they are read as they were is tested with the reader."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.document.evaluation_writer import evaluation_text
from mjrun.errors import UsageError
from mjrun.evaluation.evaluation import Evaluation
from tests.evaluation.tasks import cart_task


def test_only_what_is_not_the_default_is_written(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    text = evaluation_text(
        Evaluation(task, "out", policy="zero", episodes=7), ["duration=1", "duration=2"], "mjrun eval"
    )
    path = task.text
    assert text == f"# mjrun eval\ntask: {path}\nchanges: {{duration: 2}}\noutput: out\nepisodes: 7\npolicy: zero\n"


def test_code_is_no_part_of_a_document(tmp_path: Path) -> None:
    task = cart_task(tmp_path)
    for policy in ("act.py:act", np.zeros_like):
        with pytest.raises(UsageError, match="code stays on the command line"):
            evaluation_text(Evaluation(task, "out", policy=policy))
