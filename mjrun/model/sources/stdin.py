"""Standard input as a model source, written `-`."""

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import BrokenModelError, MjrunError, UsageError
from mjrun.model.model_files import existing_files
from mjrun.model.source import ModelSource, compile_spec, load_respecting_confinement, model_errors
from mjrun.model.sources.file import FileSource, parsing_checked

LABEL = Path("<stdin>")
DEVICE = Path("/dev/stdin")


@dataclass(frozen=True)
class StdinSource(ModelSource):
    """MJCF or URDF on standard input; its assets and includes are relative to the working directory.

    Standard input is read when the model is first loaded, and once per process.

    Attributes:
      xml: the text; None to read it from standard input.
    """

    xml: str | None = None

    @property
    def text(self) -> str:
        return "-"

    @property
    def stem(self) -> str:
        return "model"

    @property
    def files(self) -> tuple[Path, ...]:
        with suppress(MjrunError, OSError):  # loading raises it
            return (DEVICE, *existing_files(LABEL, self._read().encode(), overrides=self.overrides))
        return (DEVICE,)

    def stored_at(self, place: Callable[[Path], Path]) -> ModelSource:
        path = place(Path("-.xml"))  # next to the copies of its assets, as its paths are relative
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(self._read().encode())
        return FileSource(path, self.text, overrides=self.overrides)

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        xml = self._read()
        return load_respecting_confinement(lambda: self._compile(xml))

    def _compile(self, xml: str) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        with model_errors(LABEL), parsing_checked(LABEL, xml.encode(), str(LABEL), self.overrides):
            spec = mujoco.MjSpec.from_string(xml)
        return compile_spec(spec, self.overrides, LABEL)

    def __reduce__(self) -> tuple[type, tuple[()], dict[str, object]]:
        # The standard input of another process is different.
        return StdinSource, (), {"overrides": self.overrides, "xml": self._read()}

    def _read(self) -> str:
        return _standard_input() if self.xml is None else self.xml


@cache
def _standard_input() -> str:
    """Reads all of standard input.

    Raises:
      UsageError: it is a terminal, or closed.
      BrokenModelError: it is empty, or not text.
    """
    if sys.stdin is None or sys.stdin.closed or sys.stdin.isatty():
        state = "is a terminal" if sys.stdin and not sys.stdin.closed else "is closed"
        raise UsageError(
            f"the model - is read from standard input, which {state}\n"
            "pipe MJCF into it, as in `mjrun video - < scene.xml`, or name a file"
        )
    content = sys.stdin.buffer.read()
    if not content.strip():
        raise BrokenModelError(LABEL, "standard input is empty; MJCF or URDF is expected")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        reason = "standard input is not UTF-8 text; MJCF or URDF is expected, and archives are read from files only"
        raise BrokenModelError(LABEL, reason) from None
