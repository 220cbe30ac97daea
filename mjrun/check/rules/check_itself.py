"""Rules about the check itself: failures of its process, and comments in the XML of a model that suppress findings.

A comment such as `<!-- mjrun: ignore MJ503 the floor is soft -->` concerns the element that starts earlier on its
line, or else the next one, with all elements inside. `ignore-file` concerns its whole file, and findings about the
model as a whole.
"""

import re
from collections.abc import Collection, Iterable, Iterator

from mjrun.check.finding import Finding, Place, short_path
from mjrun.check.rule import Rule
from mjrun.dataclass import dataclass
from mjrun.model.xml_source import Comment

MISSING_MODEL = Rule("MJ001", "error", "no such model file")
CRASH = Rule("MJ002", "error", "MuJoCo crashes")
TIMEOUT = Rule("MJ003", "error", "check exceeds the time limit")
OUT_OF_MEMORY = Rule("MJ004", "error", "check exceeds the memory limit")
INTERNAL_ERROR = Rule("MJ005", "error", "mjrun failed to check it")
NOT_FIXED = Rule("MJ007", "error", "fault that is not fixed")
BAD_COMMENT = Rule("MJ006", "warning", "ignore comment without effect")

COMMENT = re.compile(r"mjrun:\s*(?P<kind>ignore(?:-file)?)\b(?P<codes>(?:[\s,]+MJ\d*\b)*)", re.IGNORECASE)


@dataclass
class IgnoreComment:
    """A comment that suppresses findings.

    Attributes:
      codes: the codes, or beginnings of codes, that it names.
      lines: the lines of its file that it concerns; None for the whole file.
      is_used: it has suppressed a finding.
    """

    comment: Comment
    codes: tuple[str, ...]
    lines: range | None
    is_used: bool = False

    @property
    def file(self) -> str:
        """The file of the comment, as findings name it."""
        return short_path(self.comment.file)

    def matches(self, finding: Finding) -> bool:
        """Returns whether it suppresses a finding."""
        if not finding.code.startswith(self.codes) or finding.file != self.file:
            return False
        return self.lines is None or (finding.line is not None and finding.line in self.lines)


class IgnoreComments:
    """The comments of one model, which record whether they suppress anything."""

    def __init__(self, comments: Iterable[Comment]) -> None:
        self.comments = [ignoring for comment in comments if (ignoring := _ignoring(comment))]
        self.suppressed = 0

    def remaining(self, findings: Iterable[Finding]) -> Iterator[Finding]:
        """Yields the findings that no comment suppresses."""
        for finding in findings:
            matching = [comment for comment in self.comments if comment.matches(finding)]
            for comment in matching:
                comment.is_used = True
            if matching:
                self.suppressed += 1
            else:
                yield finding

    def unused(self, applied: Collection[str], known: Collection[str]) -> Iterator[Finding]:
        """Yields a finding for each comment that is invalid, or has suppressed nothing although its rules were applied.

        Args:
          applied: the codes of the rules that were applied.
          known: the codes of all rules.
        """
        for comment in self.comments:
            named = {code for code in known if comment.codes and code.startswith(comment.codes)}
            if not comment.codes:
                message, remedy = "it names no code", "write the code of a rule: <!-- mjrun: ignore MJ503 reason -->"
            elif not named:
                message, remedy = f"no rule begins with {' or '.join(comment.codes)}", "write the code of a rule"
            elif not comment.is_used and named.issubset(applied):
                message, remedy = f"nothing is left to ignore: {', '.join(comment.codes)}", "remove the comment"
            else:
                continue
            yield BAD_COMMENT.finding(message, remedy, Place(comment.comment.file, comment.comment.line))


def _ignoring(comment: Comment) -> IgnoreComment | None:
    """Returns what a comment suppresses; None for another comment."""
    match = COMMENT.match(comment.text)
    if match is None:
        return None
    codes = tuple(code.upper() for code in re.split(r"[\s,]+", match["codes"]) if code)
    if match["kind"].lower() == "ignore-file":
        return IgnoreComment(comment, codes, None)
    element = comment.element
    return IgnoreComment(comment, codes, range(element.line, element.last_line + 1) if element else range(0))
