"""The check of models and tasks; tasks are read from their documents."""

from typing import ClassVar

from mjrun.check.check import ModelCheck
from mjrun.options.option import options


@options
class Check(ModelCheck):
    """A check of models and tasks for errors, and for likely causes of later errors.

    Args:
      models: files, including task documents, and folders, which represent all models in them.

    Raises:
      UsageError: a code, severity or number is invalid.
    """

    task_reader: ClassVar[str] = "mjrun.document.task:read_task"  # imported by the worker alone
