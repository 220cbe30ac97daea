"""Theorems about the interface of sources: a collection offers its models by name."""

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import mujoco
import pytest

from mjrun.dataclass import dataclass
from mjrun.errors import ModelError, ModelNotFoundError, SystemLimitError
from mjrun.model.source import CollectionModelSource, broken_model


@dataclass(frozen=True)
class TaskSource(CollectionModelSource):
    PREFIX: ClassVar[str] = "task"
    KIND: ClassVar[str] = "task"

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        return {"humanoid/walk": "Walks.", "humanoid/run": "Runs."}

    def compile(self) -> tuple[None, mujoco.MjModel]:
        self.check_name()
        return None, mujoco.MjModel.from_xml_string("<mujoco/>")


def test_a_named_source_is_written_with_its_prefix_and_names_outputs_without_folders() -> None:
    source = TaskSource("humanoid/walk")
    assert (source.text, source.stem, source.main_file, source.files) == (
        "task:humanoid/walk",
        "humanoid_walk",
        None,
        (),
    )
    assert source.load().nbody == 1


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("humanoid/wlak", "task:humanoid/wlak: no such task (did you mean 'humanoid/walk' or 'humanoid/run'?)"),
        ("", "task: name the task"),
    ],
)
def test_an_unknown_name_is_answered_with_the_collection(name: str, first: str) -> None:
    with pytest.raises(ModelNotFoundError) as caught:
        TaskSource(name).load()
    assert str(caught.value).splitlines() == [first, "tasks: humanoid/walk, humanoid/run"]


def test_errors_about_a_model_begin_with_its_source_once() -> None:
    source = TaskSource("humanoid/walk")
    with pytest.raises(ModelError, match=r"^task:humanoid/walk: its start is nan$"), source.named_in_errors():
        raise ModelError("its start is nan")
    own = ModelNotFoundError(Path("a.xml"), "no such model file")
    with pytest.raises(ModelNotFoundError) as caught, source.named_in_errors():
        raise own
    assert caught.value is own


def test_a_model_that_is_not_compiled_for_lack_of_threads_is_not_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    unknown = RuntimeError("Caught an unknown exception!")
    assert "MuJoCo ran out of memory" in str(broken_model(Path("a.xml"), unknown))

    def start(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(SystemLimitError, match="the system starts no other process or thread"):
        broken_model(Path("a.xml"), unknown)
