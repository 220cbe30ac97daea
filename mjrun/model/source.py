"""The interface of everything that stands where a model stands: a file, standard input, `scene:dominos`."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self

import mujoco

from mjrun.errors import ModelError, ModelNotFoundError, clean
from mjrun.model.override import Override


@dataclass(frozen=True)
class Source(ABC):
    """Where a model comes from, and the overrides to load it with: a picklable value.

    Attributes:
      overrides: overrides, applied in order before compilation.
    """

    overrides: tuple[Override, ...] = field(default=(), kw_only=True)

    @property
    @abstractmethod
    def text(self) -> str:
        """The source as users, documents and manifests write it."""

    @property
    @abstractmethod
    def stem(self) -> str:
        """The base of the names of outputs, without a folder or a suffix."""

    @property
    def main_file(self) -> Path | None:
        """The model file; None if there is none."""
        return None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that loading reads, the model file first, as far as they are known without compiling."""
        return ()

    def with_overrides(self, overrides: Sequence[Override]) -> Self:
        """The same source with more overrides, after its own."""
        return replace(self, overrides=(*self.overrides, *overrides))

    def stored_at(self, place: Callable[[Path], Path]) -> "Source":
        """Returns the same model, its files read where `place` says; errors and results still name the originals."""
        return self

    @property
    def code(self) -> str:
        """What decides, beside its files, what is simulated under a policy: code by its version; empty for none."""
        return ""

    def load(self) -> mujoco.MjModel:
        """Compiles the model.

        Raises:
          ModelError: it cannot be found or read, or MuJoCo refuses it.
          UsageError: an override names nothing, or its value does not fit.
        """
        return self.compile()[1]

    @contextmanager
    def named_in_errors(self) -> Iterator[None]:
        """Within the `with` block, errors about the model begin with this source."""
        try:
            yield
        except ModelError as error:
            if type(error) is not ModelError:  # it says which file by itself
                raise
            raise ModelError(f"{clean(self.text)}: {error}") from None

    @abstractmethod
    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        """The specification, None where there is only a compiled model, and the model; raises what `load` does."""


@dataclass(frozen=True)
class CollectionSource(Source):
    """A model out of a collection, written `PREFIX:NAME`. A module in `mjrun.model.sources` holds each collection."""

    PREFIX: ClassVar[str]
    KIND: ClassVar[str] = "model"  # what each of them is called
    NO_TASK: ClassVar[str] = ""  # why a policy cannot play what is a task elsewhere

    name: str

    @classmethod
    @abstractmethod
    def descriptions(cls) -> Mapping[str, str]:
        """A line about each model of the collection, by name."""

    @property
    def text(self) -> str:
        return f"{self.PREFIX}:{self.name}"

    @property
    def stem(self) -> str:
        return re.sub(r"\W+", "_", self.name)

    @property
    def label(self) -> str:
        """What errors call it: the prefix alone where no model is named."""
        return self.text if self.name else self.PREFIX

    def check_name(self, name: str | None = None) -> None:
        """Raises ModelNotFoundError, which lists the collection, if it has no model of this name, or of `name`."""
        name = self.name if name is None else name
        if name in (valid := self.descriptions()):
            return
        reason = "no such" if name else "name the"
        raise ModelNotFoundError(self.label, f"{reason} {self.KIND}", [*valid], f"{self.KIND}s", name)
