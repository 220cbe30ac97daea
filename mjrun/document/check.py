"""`mjrun check` of models and of tasks, which it reads from their documents."""

from typing import ClassVar

from mjrun.check.check import Check as ModelCheck
from mjrun.document.task import read_task
from mjrun.options.option import options


@options
class Check(ModelCheck):
    """Checks models and tasks for errors, and for what is likely to become one.

    Args:
      models: files, task documents among them, and folders, which stand for all models below them.

    Raises:
      UsageError: a code, severity or number is invalid.
    """

    task_reader: ClassVar[str] = f"{read_task.__module__}:{read_task.__name__}"
