"""Benchmarks from end to end: comparisons with a baseline, saved documents, and refused options."""

import functools
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from mjrun.bench.block_timing import BatchRolloutTimer, Clock
from mjrun.bench.results import BaselineComparison
from mjrun.bench.step_timing import StepTimer
from mjrun.errors import BadValueError, FileError, ModelNotFoundError, UsageError
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from tests.bench.bench_clocks import MODEL, FakeClock, SimulatedMachine, bench
from tests.cases import cases


def compared(path: Path, machine: SimulatedMachine) -> BaselineComparison:
    job = bench(path, repeats=20, compare=str(path.with_name("base.json")), fail_above=0.1)
    comparison = job.run(clock=machine).comparison
    assert comparison is not None
    return comparison


@functools.cache
def noisy_baseline(model: str) -> str:
    """Returns the baseline of a simulated machine with noise of 3 %."""
    with TemporaryDirectory() as folder:
        path, base = Path(folder, "model.xml"), Path(folder, "base.json")
        path.write_text(model)
        bench(path, repeats=20, save=str(base)).run(clock=SimulatedMachine(noise=0.03, seed=99))
        return base.read_text()


@pytest.fixture
def base(path: Path, simulated: None) -> Path:
    """The model, beside a baseline of a machine with noise of 3 %."""
    path.with_name("base.json").write_text(noisy_baseline(path.read_text()))
    return path


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes steps take the time of a `SimulatedMachine`, if that is the clock of the benchmark."""
    rollout, seconds = Batch.rollout, BatchRolloutTimer.seconds
    clocks: list[Clock] = []

    def timed(self: BatchRolloutTimer, steps: int, block: int, clock: Clock) -> np.ndarray:
        clocks[:] = [clock]
        return seconds(self, steps, block, clock)

    def counted(self: Batch, nstep: int, *arguments: Any, **settings: Any) -> Any:
        if isinstance(clocks[0], SimulatedMachine):
            clocks[0].took(self, nstep)
        return rollout(self, nstep, *arguments, **settings)

    monkeypatch.setattr(BatchRolloutTimer, "seconds", timed)
    monkeypatch.setattr(Batch, "rollout", counted)


@pytest.mark.parametrize("slowdown", [1.5, 0.3])
def test_a_slowdown_of_the_subject_by_30_percent_is_found_however_slow_the_machine_is(
    base: Path, slowdown: float
) -> None:
    result = compared(base, SimulatedMachine(1.3, lambda now: slowdown, 0.03, 5))
    assert result.verdict == "slower"
    assert [ratio.name for ratio in result.ratios] == ["step", "threads 2"]
    for ratio in result.ratios:
        assert ratio.ratio == pytest.approx(1.3, rel=0.05)
        assert ratio.reference_workload == pytest.approx(slowdown, rel=0.05)
    assert compared(base, SimulatedMachine(0.7, lambda now: slowdown, 0.03, 6)).verdict == "faster"


@pytest.mark.parametrize(
    ("slowdown", "seed"),
    [
        (lambda now: 1.0, 0),
        (lambda now: 0.5, 1),
        (lambda now: 8.0, 0),
        (lambda now: 1.0 if now < 1.0 else 1.7, 1),  # another process starts on the way
        (lambda now: 1.5 + 0.5 * np.sin(now), 0),  # the clock frequency wanders
    ],
)
def test_a_machine_that_slows_down_as_a_whole_makes_nothing_slower_and_noise_does_not_either(
    base: Path, slowdown: Callable[[float], float], seed: int
) -> None:
    result = compared(base, SimulatedMachine(1.0, slowdown, 0.03, seed))
    assert result.verdict == "not slower"
    assert all(ratio.low and ratio.high and ratio.low < 1 < ratio.high for ratio in result.ratios)


@pytest.mark.usefixtures("simulated")
def test_any_factor_of_the_whole_machine_leaves_every_ratio_as_it_is(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base).run(clock=SimulatedMachine(noise=0.1, seed=1))
    slow = bench(path, compare=base).run(clock=SimulatedMachine(1.2, lambda now: 4.0, 0.1, 2)).comparison
    usual = bench(path, compare=base).run(clock=SimulatedMachine(1.2, noise=0.1, seed=2)).comparison
    assert slow is not None
    assert usual is not None
    for here, there in zip(slow.ratios, usual.ratios, strict=True):
        # The machine is slower by a power of two, which leaves all quotients as they are to the last bit.
        assert (here.ratio, here.low, here.high, here.fastest) == (there.ratio, there.low, there.high, there.fastest)
        assert (here.now, here.verdict) == (4 * there.now, there.verdict)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda base: base.pop("reference_workload"), "the baseline has no reference workload"),
        (lambda base: base["reference_workload"].update(version=0), "the baseline has another reference workload"),
        (lambda base: base.update(mujoco="3.9.9"), "MuJoCo 3.9.9 simulated the reference workload"),
    ],
)
def test_a_baseline_without_the_same_workload_is_compared_by_wall_times_with_a_note(
    path: Path, spoil: Callable[[dict[str, Any]], object], reason: str
) -> None:
    base = path.with_name("base.json")
    bench(path, save=str(base)).run(clock=FakeClock())
    document = json.loads(base.read_text())
    spoil(document)
    base.write_text(json.dumps(document))
    result = bench(path, compare=str(base)).run(clock=FakeClock(1.5))
    assert result.comparison is not None
    assert result.comparison.ratios[0].ratio == pytest.approx(1.5)
    assert result.comparison.ratios[0].reference_workload is None
    assert result.comparison.verdict == "slower"
    assert [reason in note for note in result.notes if "wall times are compared directly" in note] == [True]


def test_a_base_is_refused_before_anything_is_timed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base).run(clock=FakeClock())
    monkeypatch.setattr(StepTimer, "warm_up", lambda self: pytest.fail("was timed"))
    with pytest.raises(UsageError, match=r"noise_std: 0.01 there, 0.5 here\nforce"):
        bench(path, compare=base, noise_std=0.5).run(clock=FakeClock())
    with pytest.raises(UsageError, match="another model"):
        bench(FileSource(path, overrides=(Override("opt.gravity", "0,0,-1"),)), compare=base).run(clock=FakeClock())
    with pytest.raises(FileError, match="cannot be read"):
        bench(path, compare="none.json").run(clock=FakeClock())


def test_what_differs_may_be_compared_by_force_and_is_reported(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base).run(clock=FakeClock())
    result = bench(path, compare=base, noise_std=0.5, force=True).run(clock=FakeClock()).comparison
    assert result is not None
    assert result.differences == ["noise_std: 0.01 there, 0.5 here"]


def test_a_benchmark_takes_as_many_steps_as_its_base(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base, steps=33).run(clock=FakeClock())
    result = bench(path, compare=base, steps=None).run(clock=FakeClock())
    assert result.rows[0].steps == 33
    assert result.comparison is not None


def test_what_is_saved_is_the_document_and_appears_whole(path: Path) -> None:
    base = path.with_name("base.json")
    result = bench(path, save=str(base)).run(clock=FakeClock())
    assert json.loads(base.read_text()) == json.loads(json.dumps(asdict(result)))
    with pytest.raises(FileError, match="is not a folder"):
        bench(path, save="/dev/null/base.json").run(clock=FakeClock())
    before = base.read_text()
    with pytest.raises(ModelNotFoundError):
        bench(path.with_name("none.xml"), save=str(base)).run(clock=FakeClock())
    assert base.read_text() == before


def test_a_compiled_model_is_timed_but_not_loaded() -> None:
    result = bench(mujoco.MjModel.from_xml_string(MODEL)).run(clock=FakeClock())
    assert (result.load, result.model.path, result.model.file_sha256) == (None, "", None)
    assert result.model.nv == 1
    with pytest.raises(UsageError, match="give its file"):
        bench(mujoco.MjModel.from_xml_string(MODEL), scan={"timestep": [".1"]})


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"steps": 0}, "steps: '0' is not a whole number of at least 1"),
        ({"repeats": -1}, "repeats"),
        ({"noise_std": 1.1}, "noise_std: '1.1' is not a number from 0 to 1"),
        ({"noise_rate": float("nan")}, "noise_rate"),
        ({"threads": [0]}, "threads: '0' is not a number of threads, at least 1, or auto"),
        ({"threads": ["all"]}, "threads"),
        ({"budget": 0}, "budget: '0' is not a positive number"),
        ({"horizon": -1}, "horizon"),
        ({"fail_above": -0.1}, "fail_above"),
    ],
)
def test_numbers_that_cannot_be_are_refused_at_once(path: Path, changed: dict[str, Any], expected: str) -> None:
    with pytest.raises(BadValueError, match=expected):
        bench(path, **changed)


@cases("changed, message")
def test_options_that_would_be_ignored_are_refused(path: Path, changed: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        bench(path, **changed)
