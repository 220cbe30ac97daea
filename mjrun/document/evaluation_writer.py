"""From an evaluation back to the document that makes it."""

from collections.abc import Sequence

from mjrun.document.run_writer import plain_options, plain_value, text_of
from mjrun.document.tree import Mapped
from mjrun.evaluation.evaluation import Evaluation
from mjrun.options.kinds import Settings


def evaluation_text(evaluation: Evaluation, changes: Sequence[str] = (), command: str = "") -> str:
    """The evaluation document of `evaluation`; it holds what is not the default, and not how this machine plays it.

    Args:
      changes: `key=value`, what is changed in the document of its task.
      command: what made the evaluation, for a comment.

    Raises:
      UsageError: a document cannot hold this: code, or a folder outside of the current one.
    """
    pairs = dict(change.split("=", 1) for change in changes)  # as it is for the task, the last of a key counts
    changed: Mapped = {"changes": plain_value(Settings(), [*pairs.items()])} if pairs else {}
    return text_of({"task": evaluation.task.text, **changed, **plain_options(evaluation)}, command)
