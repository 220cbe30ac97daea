"""The interface of model sources: a file, standard input, `scene:dominos`."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from pathlib import Path
from typing import ClassVar, Self

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import ModelError, ModelNotFoundError, clean
from mjrun.model.override import Override


@dataclass(frozen=True)
class ModelSource(ABC):
    """A model source and the overrides to load it with: a picklable value, which compiles the model each time.

    Attributes:
      overrides: the overrides, applied in order before compilation.
    """

    overrides: tuple[Override, ...] = field(default=(), kw_only=True)

    @property
    @abstractmethod
    def text(self) -> str:
        """The source as users, documents and manifests write it."""

    @property
    @abstractmethod
    def stem(self) -> str:
        """The base of output names, without folder and suffix."""

    @property
    def main_file(self) -> Path | None:
        """The model file, or None."""
        return None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that loading reads, the model file first, as far as known without compiling."""
        return ()

    @property
    def hidden_groups(self) -> Mapping[str, Sequence[int]]:
        """The groups of geoms, except planes, and of sites that images omit by default."""
        return {}

    def with_overrides(self, overrides: Sequence[Override]) -> Self:
        """Returns the same source with more overrides, after its own."""
        return replace(self, overrides=(*self.overrides, *overrides))

    def stored_at(self, place: Callable[[Path], Path]) -> "ModelSource":
        """Returns the same model with its files read at `place(path)`; errors and results still name the originals."""
        return self

    @property
    def code(self) -> str:
        """Text that identifies the source together with its files, such as code and versions; empty without any."""
        return ""

    def load(self) -> mujoco.MjModel:
        """Compiles the model.

        Raises:
          ModelError: it cannot be found or read, or MuJoCo refuses it.
          UsageError: an override names nothing, or its value does not fit.
        """
        return self.compile()[1]

    @contextmanager
    def named_in_errors(self) -> Generator[None]:
        """Makes errors about the model within the `with` block begin with this source."""
        try:
            yield
        except ModelError as error:
            if type(error) is not ModelError:  # subclasses name the file themselves
                raise
            raise ModelError(f"{clean(self.text)}: {error}") from None

    @abstractmethod
    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        """Returns the specification, None for a compiled model, and the model; raises the errors of `load`."""


@dataclass(frozen=True)
class CollectionEntry:
    """A line in the list of a collection.

    Attributes:
      facts: what the list states, by the name of the column.
    """

    name: str
    facts: Mapping[str, str]


@dataclass(frozen=True)
class CollectionModelSource(ModelSource):
    """A model in a collection, written `PREFIX:NAME`. A module in `mjrun.model.sources` defines each collection."""

    PREFIX: ClassVar[str]
    KIND: ClassVar[str] = "model"  # the noun for its members
    NO_TASK: ClassVar[str] = ""  # the reason why a policy cannot play it like a task of other collections

    name: str

    @classmethod
    @abstractmethod
    def descriptions(cls) -> Mapping[str, str]:
        """Returns a line about each model of the collection, by name."""

    @classmethod
    def entries(cls) -> Sequence[CollectionEntry]:
        """Returns the lines of a list of the collection; a collection may be listed by groups of its models."""
        return [CollectionEntry(name, {"description": text}) for name, text in cls.descriptions().items()]

    @classmethod
    def remark(cls) -> str:
        """Returns a sentence below the list; empty for none."""
        return ""

    @property
    def text(self) -> str:
        return f"{self.PREFIX}:{self.name}"

    @property
    def stem(self) -> str:
        return re.sub(r"\W+", "_", self.name)

    @property
    def label(self) -> str:
        """The source in errors: the prefix alone if no model is named."""
        return self.text if self.name else self.PREFIX

    def check_name(self, name: str | None = None) -> None:
        """Raises ModelNotFoundError, listing the collection, if it has no model called `name`, by default its own."""
        name = self.name if name is None else name
        if name in (valid := self.descriptions()):
            return
        reason = "no such" if name else "name the"
        raise ModelNotFoundError(self.label, f"{reason} {self.KIND}", [*valid], f"{self.KIND}s", name)
