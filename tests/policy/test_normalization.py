"""Statistics of observations: read from what VecNormalize saves, without running it, and applied as it does."""

import os
import pickle
import sys
import tracemalloc
import types
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.policy.load import (
    InertPickledObject,
    NormalizedPolicy,
    PythonPolicy,
    normalized,
    read_inert,
    read_statistics,
)
from mjrun.policy.loaders.onnx import OnnxPolicy
from tests.policy.networks import LEFT_RIGHT, linear

MEAN, VAR = np.array([1.0, -2.0]), np.array([4.0, 0.0])


def vec_normalize(path: Path, monkeypatch: pytest.MonkeyPatch, **state: object) -> Path:
    """A pickle of classes with the names that Stable-Baselines3 2.9 gives them; the library need not be installed."""
    for package in ("", ".common", ".common.vec_env"):
        monkeypatch.setitem(sys.modules, f"stable_baselines3{package}", types.ModuleType("stable_baselines3"))
    for module, name in (("vec_env.vec_normalize", "VecNormalize"), ("running_mean_std", "RunningMeanStd")):
        full = f"stable_baselines3.common.{module}"
        fake = types.ModuleType(full)
        vars(fake)[name] = type(name, (), {"__module__": full})
        monkeypatch.setitem(sys.modules, full, fake)
    running = vars(sys.modules["stable_baselines3.common.running_mean_std"])["RunningMeanStd"]()
    running.__dict__.update(mean=MEAN, var=VAR, count=99.0)
    saved = vars(sys.modules["stable_baselines3.common.vec_env.vec_normalize"])["VecNormalize"]()
    saved.__dict__.update({"obs_rms": running, "epsilon": 1e-8, "clip_obs": 10.0, "norm_obs": True, **state})
    path.write_bytes(pickle.dumps(saved))
    return path


def test_statistics_of_vec_normalize_need_neither_library_nor_trust(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    statistics = read_statistics(vec_normalize(tmp_path / "a.pkl", monkeypatch))
    assert statistics is not None
    assert (statistics.mean.tolist(), statistics.var.tolist()) == (MEAN.tolist(), VAR.tolist())
    assert (statistics.epsilon, statistics.clip) == (1e-8, 10)
    # (3 - 1)/2, and a spread of 1e-4 whose value is clipped
    assert statistics.normalize(np.array([3.0, -1.0])).tolist() == [1, 10]
    assert statistics.normalize(np.array([3.0, -1.0])).dtype == np.float32


def test_rewards_alone_may_have_been_normalized(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = vec_normalize(tmp_path / "a.pkl", monkeypatch, norm_obs=False)
    policy = PythonPolicy(lambda observation: observation, "it")
    assert normalized(policy, path) is policy


def test_an_archive_of_arrays_says_the_same(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, mean=MEAN, var=VAR, epsilon=1e-8, clip=10)
    policy = normalized(PythonPolicy(lambda observation: observation, "it"), path)
    assert policy.episode(0, LEFT_RIGHT)(np.array([3.0, -1.0])).tolist() == [1, 10]
    np.savez(path, mean=MEAN, var=VAR)
    statistics = read_statistics(path)
    assert statistics is not None
    assert (statistics.epsilon, statistics.clip) == (1e-8, np.inf)


def test_a_lost_normalization_is_visible(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", mean=MEAN, var=VAR + 1)
    policy = OnnxPolicy(linear(tmp_path / "a.onnx", np.eye(2, dtype=np.float32)), "a.onnx")
    observation = np.array([3.0, -1.0])
    plain, other = (each.episode(0, LEFT_RIGHT) for each in (policy, normalized(policy, tmp_path / "a.npz")))
    assert plain(observation).tolist() != other(observation).tolist()


def test_sizes_that_do_not_fit_show_both_sides(tmp_path: Path) -> None:
    np.savez(tmp_path / "s.npz", mean=MEAN, var=VAR)
    policy = OnnxPolicy(linear(tmp_path / "a.onnx", np.ones((2, 3), np.float32)), "a.onnx")
    with pytest.raises(UsageError, match=r"s.npz has statistics of 2 numbers, and policy a.onnx observes 3"):
        normalized(policy, tmp_path / "s.npz")
    unknown = normalized(PythonPolicy(lambda observation: observation, "it"), tmp_path / "s.npz")
    assert isinstance(unknown, NormalizedPolicy)
    with pytest.raises(UsageError, match=r"s.npz has statistics of 2 numbers, and the task has 3"):
        unknown.episode(0, LEFT_RIGHT)(np.ones(3))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mean": MEAN}, "lacks statistics: mean, var, epsilon and clip"),
        ({"mean": MEAN, "var": np.ones(3)}, "two lists of equally many finite numbers"),
        ({"mean": MEAN, "var": -VAR}, "var of at least 0"),
        ({"mean": [np.nan, 0], "var": VAR}, "finite"),
        ({"mean": np.ones((2, 2)), "var": np.ones((2, 2))}, "two lists"),
        ({"mean": ["a", "b"], "var": VAR}, "'mean' holds text, not numbers"),
        ({"mean": MEAN, "var": VAR, "clip": 0}, "two lists"),
    ],
)
def test_what_is_no_statistics_is_refused(tmp_path: Path, values: dict[str, object], message: str) -> None:
    np.savez(tmp_path / "a.npz", **values)  # type: ignore[arg-type]
    with pytest.raises(FileError, match=message):
        read_statistics(tmp_path / "a.npz")


def test_files_of_other_kinds_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match=r"a.csv is not a file of statistics: expected .pkl, .pickle, .npz, or none"):
        read_statistics(tmp_path / "a.csv")
    with pytest.raises(FileError, match="no such file"):
        read_statistics(tmp_path / "a.pkl")
    (tmp_path / "a.npz").write_bytes(b"PK\3\4damaged")
    with pytest.raises(FileError, match="cannot be read as"):
        read_statistics(tmp_path / "a.npz")
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"obs_rms": 3}))
    with pytest.raises(FileError, match="is not a VecNormalize of Stable-Baselines3"):
        read_statistics(tmp_path / "a.pkl")
    with pytest.raises(FileError, match="several observations by name"):
        read_statistics(vec_normalize(tmp_path / "a.pkl", monkeypatch, obs_rms={"a": 1}))


def test_only_the_statistics_of_an_archive_are_read_and_only_if_they_are_in_proportion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mjrun.decompression_limits.FREE", 2**20)
    large = np.zeros(2**20)
    np.savez_compressed(tmp_path / "a.npz", mean=MEAN, var=VAR, other=large)
    statistics = read_statistics(tmp_path / "a.npz")
    assert statistics is not None
    assert statistics.mean.tolist() == MEAN.tolist()
    np.savez_compressed(tmp_path / "b.npz", mean=large, var=large)
    tracemalloc.start()
    try:
        with pytest.raises(FileError, match=r"b\.npz: would expand to 0\.0168 GB in memory, 1,0\d\d times its size"):
            read_statistics(tmp_path / "b.npz")
        assert tracemalloc.get_traced_memory()[1] < large.nbytes / 4
    finally:
        tracemalloc.stop()


class Plain:
    def __init__(self) -> None:
        self.array, self.number, self.inner = np.arange(6.0).reshape(2, 3), np.float64(2.5), OrderedDict(a=np.ones(2))


class Calling:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_are_arrays_and_objects_their_values(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"thing": Plain()}, protocol))
    root = read_inert(path)
    assert isinstance(root, dict)
    thing = root["thing"]
    if protocol < 2:  # which makes objects by calling a function: one more that does nothing
        assert isinstance(thing, InertPickledObject)
        return
    assert thing.name.endswith("test_normalization.Plain")
    array, number, inner = thing.values["array"], thing.values["number"], thing.values["inner"]
    assert isinstance(inner, InertPickledObject)
    assert np.array_equal(np.asarray(array), Plain().array)
    assert float(np.asarray(number)) == 2.5
    assert np.asarray(inner.values["a"]).tolist() == [1, 1]


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["f2", "<f4", ">f8", "i1", "u8", "?"])
@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_arrays_of_any_numbers_are_read(tmp_path: Path, order: str, kind: str, protocol: int) -> None:
    array = np.arange(6).reshape(2, 3).astype(kind, order=order)  # type: ignore[call-overload]
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(array, protocol))
    read = np.asarray(read_inert(tmp_path / "a.pkl"))
    assert np.array_equal(read, array)
    assert np.asarray(read_inert(tmp_path / "a.pkl"), np.float64).dtype == np.float64


@pytest.mark.parametrize("array", [np.array(["a"]), np.array([{}], object), np.zeros(2, "f8,i4"), np.array([1j])])
def test_arrays_of_anything_else_are_not(tmp_path: Path, array: np.ndarray) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(array))
    with pytest.raises(ValueError, match=r"its numbers have the unsupported type|does not hold numbers"):
        np.asarray(read_inert(tmp_path / "a.pkl"))


def test_no_code_runs(tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps([Calling(tmp_path / "made"), np.ones(3)]))
    inert, array = read_inert(path)  # type: ignore[misc]
    assert (inert.name, np.asarray(array).tolist()) == ("posix.mkdir", [1, 1, 1])
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    "content", [b"", b"no pickle", pickle.dumps(np.ones(9))[:-20], b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x7f"]
)
def test_what_is_damaged_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"a.pkl: is not a pickle, or is damaged"):
        read_inert(path)


def test_settings_of_vec_normalize_may_be_numbers_of_numpy_and_must_be_floats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.pkl"
    statistics = read_statistics(vec_normalize(path, monkeypatch, epsilon=np.float64(1e-6), clip_obs=np.float32(5)))
    assert statistics is not None
    assert (statistics.epsilon, statistics.clip) == (1e-6, 5)
    with pytest.raises(FileError, match="lacks statistics"):
        read_statistics(vec_normalize(path, monkeypatch, epsilon=10**400))
