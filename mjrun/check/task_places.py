"""Where a task is written: the file and line of each of its parts."""

from collections.abc import Iterator
from pathlib import Path

from mjrun.check.finding import Place
from mjrun.errors import DocumentError, Problem, UsageError
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds


class TaskPlaces:
    """Where a task is written.

    Args:
      task: which knows the places in its document, if there is one.
      path: of the document.
    """

    def __init__(self, task: Task, path: Path) -> None:
        self.task, self._path = task, path

    def at(self, *path: str | int) -> Place:
        """Where the part at `path` is written, such as `"actions", 0`."""
        error = UsageError("", path)
        located = self.task.places.located(error) if self.task.places else error
        return place_of(located.problems[0], self._path) if isinstance(located, DocumentError) else Place(self._path)

    def numbers_of_actions(self, worlds: TaskWorlds) -> Iterator[list[int]]:
        """Which numbers of the action vector each of the task's actions has."""
        start = 0
        for width in worlds.actions.widths:
            yield list(range(start, start + width))
            start += width


def place_of(problem: Problem, path: Path) -> Place:
    """The file and line of a problem, whose place is `task.yaml:12:5`; those of `path` where it is not in a file."""
    file, _, position = problem.place.rpartition(":")
    file, _, line = file.rpartition(":")
    if not (file and line.isdecimal() and position.isdecimal()):
        return Place(path)
    return Place(Path(file), int(line))
