"""The result of a run has those of its outputs, each with its kind."""

from dataclasses import asdict

from mjrun.outputs.keyframe import KeyframeResult
from mjrun.outputs.output import OutputResult
from mjrun.outputs.recording import RecordingResult
from mjrun.outputs.run_result import RESULTS, RunResult


def test_every_kind_of_output_is_known_by_its_name() -> None:
    assert {f"{kind}Result": result for kind, result in RESULTS.items()} == {
        result.__name__: result for result in OutputResult.__subclasses__()
    }


def test_a_document_has_the_results_in_their_order() -> None:
    key = KeyframeResult("k.xml", "end", 0.03, 3, 0.1, [])
    recording = RecordingResult("r.npz", 4, 9, 0.03, 0.1, [])
    first, second = RunResult([recording, key]).document()["results"]  # type: ignore[misc]
    assert first == {"kind": "Recording", **asdict(recording)}
    assert second == {"kind": "Keyframe", **asdict(key)}
