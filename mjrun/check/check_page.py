"""The page about a check: a card per finding, with a picture of the objects that it is about, and a card per fix."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from mjrun.check.check import CheckResult, worst_first
from mjrun.check.finding_pictures import PicturedModel, data_uri
from mjrun.check.model_result import Copy, ModelResult, without_repeats
from mjrun.check.rule import SEVERITIES, Finding
from mjrun.check.rule_table import RULES
from mjrun.errors import ModelError, NoRendererError, clean, counted
from mjrun.plotting.html_page import Page, PageCard, PageFactTable
from mjrun.plotting.page_writer import MAKER, PageWriter, origin
from mjrun.reporter import Reporter

MAX_CARDS = 300
MAX_PICTURES = 100
VISIBLE = ("geom", "key_qpos")  # the beginnings of fields whose changes can be seen


class FindingCards:
    """The cards of a page; pictures are left out where nothing renders.

    Args:
      reporter: the reporter of what is left out.

    Attributes:
      fixes: the cards of fixes.
    """

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self.fixes: list[PageCard] = []
        self._pictures = 0
        self._can_render = True

    def of(self, result: ModelResult) -> Iterator[PageCard]:
        """Yields a card for each finding of a model, the worst first."""
        model = self._pictured(result.model) if result.loads and result.findings else None
        for finding in sorted(result.findings, key=lambda each: -SEVERITIES.index(each.severity)):
            image = self._picture(model, finding)
            yield _card(finding, finding.severity, finding.remedy.splitlines(), [image] if image else [])

    def add_fixes(self, copy: Copy, findings: Sequence[Finding]) -> None:
        """Adds a card for each finding that is fixed in the copy of a model, with pictures of both if it is visible."""
        visible = [f for f in findings if any(name.startswith(VISIBLE) for fix in f.fixes for name in fix.fields)]
        models = [self._pictured(str(path)) for path in (copy.original, copy.path)] if visible else []
        for finding in findings:
            images = [self._picture(model, finding) for model in models] if finding in visible else []
            caption = ["The pictures show it before and after the fix."] if images and all(images) else []
            self.fixes.append(_card(finding, "fix", caption, images if caption else []))

    def _pictured(self, path: str) -> PicturedModel | None:
        if not self._can_render or self._pictures >= MAX_PICTURES:
            return None
        try:
            return PicturedModel(path)
        except ModelError:  # changed since, or a task
            return None

    def _picture(self, model: PicturedModel | None, finding: Finding) -> bytes:
        if model is None or not self._can_render or self._pictures >= MAX_PICTURES:
            return b""
        try:
            image = model.picture(finding)
        except NoRendererError as error:
            self._reporter.warn(f"the page has no pictures: {str(error).partition(chr(10))[0]}")
            self._can_render = False
            return b""
        self._pictures += bool(image)
        return image


def write_check_page(path: str, result: CheckResult, summary: str, makers: FindingCards, command: str) -> None:
    """Writes the page, with the cards of fixes at the end.

    Args:
      command: the command line, for the page.

    Raises:
      BadValueError: `path` does not end with .html.
      FileError: the page cannot be written.
    """
    cards = list[PageCard]()
    shown = [*without_repeats(worst_first(result.models))]
    for model in shown:
        if len(cards) < MAX_CARDS:
            cards += makers.of(model)
    cards += makers.fixes
    found = sum(len(model.findings) for model in shown)
    notes = [summary] + ([f"{counted(found - MAX_CARDS, 'more finding')} …"] if found > MAX_CARDS else [])
    versions = {"mujoco": mujoco.mj_versionString(), "numpy": np.__version__}
    models = [model.model for model in result.models[:MAX_CARDS]]
    page = Page(
        "Check of models",
        MAKER,
        cards=cards[:MAX_CARDS],
        facts=[_models(result)] if found else [],
        manifests=[origin("This check", command, models, versions)],
        notes=notes,
    )
    with PageWriter(path) as writer:
        writer.write(page)
        writer.publish()


def _card(finding: Finding, level: str, others: Sequence[str], images: Sequence[bytes]) -> PageCard:
    place = finding.file + (f":{finding.line}" if finding.line else "")
    return PageCard(
        f"{finding.code} {RULES[finding.code].title}",
        level,
        tuple(filter(None, (clean(place), clean(finding.object)))),
        tuple(clean(text) for text in (finding.text, *others)),
        tuple(map(data_uri, images)),
    )


def _models(result: CheckResult) -> PageFactTable:
    rows: list[tuple[str, ...]] = []
    faulty = [model for model in worst_first(result.models) if model.findings or not model.loads]
    for model in faulty[:MAX_CARDS]:
        counts = [str(model.count(severity) or "") for severity in reversed(SEVERITIES)]
        rows.append((clean(model.model), *counts, "" if model.loads else "does not load"))
    return PageFactTable(
        "Models", "Models with findings, the worst first", ("Model", "Errors", "Warnings", "Notes", ""), rows, (1, 2, 3)
    )
