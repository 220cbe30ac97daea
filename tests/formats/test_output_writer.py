"""Outputs that appear whole or not at all, together or alone."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from mjrun.errors import ClosedPipeError, FileError, MjrunError, PartlyDoneError
from mjrun.formats import temporary_output
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import (
    OutputWriter,
    StagedFile,
    StagedFrameFolder,
    StagedFramePattern,
    publish_together,
)
from tests.formats.file_faults import MOST, fault
from tests.formats.outputs import both_ways, fill, names

TOGETHER = [
    (StagedFile, "a"),
    (StagedFile, "b"),
    (StagedFrameFolder, "frames"),
    (StagedFramePattern, "f_%d.png"),
    (StagedFile, "c"),
]


def publish_all(folder: Path, text: str) -> None:
    """Publishes outputs of every kind together."""
    with ExitStack() as stack:
        writers = [stack.enter_context(OutputWriter(make(folder / name))) for make, name in TOGETHER]
        for writer in writers:
            fill(writer.destination, 2, text)
        publish_together(writers)


def state(folder: Path) -> dict[str, str]:
    """The content of every file, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.slow
@both_ways
@pytest.mark.parametrize(("kind", "had"), [("once", True), ("from then on", True), ("from then on", False)])
def test_of_outputs_that_belong_together_all_are_new_or_none_or_the_message_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchange: Callable[[Path, Path], bool], kind: str, had: bool
) -> None:
    monkeypatch.setattr(temporary_output, "exchange", exchange)
    number = 0
    while True:
        number += 1
        assert number < MOST
        here = tmp_path / str(number)
        here.mkdir()
        if had:
            publish_all(here, "old")
        before, error = state(here), None
        with fault(number, kind) as tried:
            try:
                publish_all(here, "new")
            except MjrunError as caught:
                error = caught
        after = {path: text for path, text in state(here).items() if not path.startswith(".")}
        if isinstance(error, PartlyDoneError):
            assert kind == "from then on"
            for _, name in TOGETHER:
                made = [text for path, text in after.items() if path.startswith(name.partition("%")[0])]
                is_old = all(text.startswith("old") for text in made) and bool(made) == had
                told = [f["output"] for f in error.failures if "the next run" in str(f["message"])]
                assert is_old or str(here / name) in [*error.made, *told]
        elif error:
            assert "the next run" in str(error) or after == before
        else:
            assert len(after) == 7
            assert all(text.startswith("new") for text in after.values())

        for make, name in TOGETHER:
            make(here / name).cleanup()
        assert not list(here.glob(".*"))
        if len(tried) < number:
            break
    assert number > 10
    assert not error


def test_an_output_that_cannot_be_finished_leaves_the_others_as_they_were(tmp_path: Path) -> None:
    class Failing(OutputWriter):
        def finish(self) -> None:
            raise FileError(self.destination.shown, "cannot be written: the disk is full")

    with OutputWriter(StagedFile(tmp_path / "a")) as one, Failing(StagedFile(tmp_path / "b")) as other:
        with pytest.raises(FileError, match="b: cannot be written: the disk is full"):
            publish_together([one, other])
        assert not (tmp_path / "a").exists()


class Lines(OutputWriter):
    """A writer of one file; fails on request while it opens."""

    def __init__(self, path: Path, failure: BaseException | None = None) -> None:
        super().__init__(StagedFile(path))
        with self.opening():
            self.file = self.open_file()
            if failure:
                raise failure


def test_a_writer_that_fails_while_it_opens_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="a: cannot be written: No space left on device"):
        Lines(tmp_path / "a", OSError(28, "No space left on device"))
    with pytest.raises(ClosedPipeError):
        Lines(tmp_path / "a", BrokenPipeError())
    with pytest.raises(KeyboardInterrupt):
        Lines(tmp_path / "a", KeyboardInterrupt())
    assert names(tmp_path) == []


def test_a_file_that_cannot_be_opened_is_an_error_of_its_output(tmp_path: Path) -> None:
    with OutputWriter(StagedFile(tmp_path / "a")) as output:
        temporary = Path(output.destination.path)
        temporary.unlink()
        temporary.mkdir()
        with pytest.raises(FileError, match="a: cannot be written: Is a directory"):
            output.open_file()
        temporary.rmdir()
    assert names(tmp_path) == []


def test_a_file_that_cannot_be_written_at_once_leaves_nothing(tmp_path: Path) -> None:
    wrong: Any = "not bytes"
    with pytest.raises(TypeError):
        written_file(tmp_path / "a", wrong)
    assert names(tmp_path) == []
    with written_file(tmp_path / "a", b"kept") as output:
        output.publish()
    assert (tmp_path / "a").read_bytes() == b"kept"


def test_what_the_system_refuses_is_named_with_the_output(tmp_path: Path) -> None:
    with OutputWriter(StagedFile(tmp_path / "a")) as writer:
        Path(writer.destination.path).unlink()
        Path(writer.destination.path).mkdir()
        with pytest.raises(FileError, match="a: cannot be written: Is a directory"):
            writer.write_file(b"")
        Path(writer.destination.path).rmdir()
