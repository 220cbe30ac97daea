"""The user's model with what was found: its own text, with nothing but these attributes changed."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from mjrun.errors import FileError, UsageError, clean, listing, option
from mjrun.formats.atomic_output import OutputWriter, written_file
from mjrun.formats.temporary_output import temporary_file
from mjrun.model.attribute_edits import Change, changes, with_changes
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.override import Override
from mjrun.model.source import Source
from mjrun.model.sources.file import FileSource

SUFFIX = ".xml"


@dataclass(frozen=True)
class FittedModel:
    """Where a fitted model goes.

    Attributes:
      path: an .xml file.
      source: the model that is fitted, with its overrides, which are not written.
    """

    path: Path
    source: Source

    def check(self, overrides: Sequence[Override]) -> None:
        """Proves with any values that the text can hold what is looked for.

        Raises:
          UsageError: it is no .xml file, or its text cannot hold them.
        """
        main = self._main
        if self.path.suffix != SUFFIX:
            raise UsageError(f"{option('output')} {clean(str(self.path))}: a fitted model is an {SUFFIX} file")
        elsewhere = [each.element.file.name for each in changes(main, overrides) if each.element.file != main]
        if elsewhere:
            raise UsageError(
                f"{option('output')}: what is looked for stands in {listing(list(dict.fromkeys(elsewhere)))}, which "
                f"{clean(str(main))} includes; one file is written\nleave {option('output')} out, and change the "
                "values there, or fit the included file's values where they are"
            )

    def write(self, stack: ExitStack, overrides: Sequence[Override]) -> tuple[OutputWriter, list[Change]]:
        """Writes the text, and proves that it compiles to the model with `overrides`.

        It then only has to be published; `stack` discards it otherwise.

        Raises:
          FileError: it cannot be written, or would be another model there.
        """
        made = changes(self._main, overrides)
        text = with_changes(self._main.read_bytes(), made)
        output = stack.enter_context(written_file(self.path, text))
        self._require_same(output, text, overrides)
        return output, made

    @property
    def _main(self) -> Path:
        main = self.source.main_file
        if main is None or main.suffix != SUFFIX:
            raise UsageError(f"{option('output')}: {clean(self.source.text)} has no {SUFFIX} file of its own to change")
        return main

    def _require_same(self, output: OutputWriter, text: bytes, overrides: Sequence[Override]) -> None:
        plain = replace(self.source, overrides=tuple(overrides))
        with output.writing(), temporary_file(self.path, text, SUFFIX) as beside:
            same = physics_fingerprint(FileSource(beside).load()) == physics_fingerprint(plain.load())
        if not same:
            raise FileError(
                self.path, "would not be the fitted model", "an attribute of its text stands for several numbers"
            )
