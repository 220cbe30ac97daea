"""Base class of objects that are closed, for example at the end of a `with` block."""

from abc import ABC, abstractmethod
from typing import Self


class Closable(ABC):
    """Base of objects with `close`."""

    @abstractmethod
    def close(self) -> None:
        """Closes the object; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
