"""The bundled ffmpeg."""

from pathlib import Path

import pytest

from mjrun.errors import EncoderError
from mjrun.formats.codecs import CODECS
from mjrun.formats.ffmpeg import command, encoder_version, run, working_codecs


def test_every_codec_works_here() -> None:
    assert encoder_version()
    assert working_codecs() == dict.fromkeys(CODECS, True)


def test_a_missing_encoder_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    with pytest.raises(EncoderError, match="ffmpeg cannot be run"):
        encoder_version()
    with pytest.raises(EncoderError, match="reinstall imageio-ffmpeg"):
        command("-version")


def test_a_program_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho waiting >&2\nexec sleep 600\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    monkeypatch.setattr("mjrun.formats.ffmpeg.IDLE", 0.3)
    monkeypatch.setattr("mjrun.child_process.IDLE_INTERVAL", 0.1)
    answer = run("-version")
    assert not answer.is_good
    assert (answer.status.cause, answer.log) == ("idle", "waiting\n")
