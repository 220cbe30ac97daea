"""A reporter that tests read."""

from dataclasses import dataclass, field


@dataclass
class RecordingReporter:
    """A reporter that keeps what it receives.

    Attributes:
      texts: notes, warnings and requests, in order.
      warnings: the warnings alone.
      steps: the numbers of each progress report: done, total.
    """

    texts: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    steps: list[tuple[int, int]] = field(default_factory=list)

    def note(self, text: str) -> None:
        self.texts.append(text)

    ask = note

    def warn(self, text: str) -> None:
        self.texts.append(text)
        self.warnings.append(text)

    def progress(self, what: str, done: int, total: int) -> None:
        self.steps.append((done, total))
