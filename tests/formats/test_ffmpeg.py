"""The bundled ffmpeg."""

import pytest

from mjrun.errors import EncoderError
from mjrun.formats.codecs import CODECS
from mjrun.formats.ffmpeg import command, encoder_version, working_codecs


def test_every_codec_works_here() -> None:
    assert encoder_version()
    assert working_codecs() == dict.fromkeys(CODECS, True)


def test_a_missing_encoder_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    with pytest.raises(EncoderError, match="ffmpeg cannot be run"):
        encoder_version()
    with pytest.raises(EncoderError, match="reinstall imageio-ffmpeg"):
        command("-version")
