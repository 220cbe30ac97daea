"""What is open until it is closed, as at the end of a `with` block."""

from abc import ABC, abstractmethod
from typing import Self


class Closable(ABC):
    """Base of what is to be closed."""

    @abstractmethod
    def close(self) -> None:
        """Closes it; closing it once more does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
