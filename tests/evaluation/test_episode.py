"""Who plays, and what is played, as values."""

import pickle
from pathlib import Path

from mjrun.evaluation.episode import EpisodeSpec, PolicyChoice
from tests.evaluation.tasks import cart_task


def test_a_specification_goes_to_another_process_as_it_is(tmp_path: Path) -> None:
    spec = EpisodeSpec(cart_task(tmp_path), PolicyChoice("random", "none", True), (("m", "max(time)"),))
    assert pickle.loads(pickle.dumps(spec)) == spec


def test_a_policy_is_called_by_its_text_or_by_what_it_is() -> None:
    assert PolicyChoice("walk.onnx").name == "walk.onnx"
    assert PolicyChoice(len).name == "builtin_function_or_method"
