"""The page about a check: a card per finding, with a picture of the objects that it is about."""

from collections.abc import Iterator

from mjrun.check.check import CheckResult, worst_first
from mjrun.check.finding_pictures import PicturedModel, data_uri
from mjrun.check.model_result import ModelResult
from mjrun.check.rule import SEVERITIES, Finding
from mjrun.check.rule_table import RULES
from mjrun.errors import ModelError, NoRendererError, clean, counted
from mjrun.plotting.html_page import Page, PageCard, PageFacts
from mjrun.plotting.page_writer import MAKER, PageWriter
from mjrun.reporter import Reporter

MAX_CARDS = 300
MAX_PICTURES = 100


class FindingCards:
    """The cards of a page; pictures are left out where nothing renders.

    Args:
      reporter: the reporter of what is left out.
    """

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self._pictures = 0
        self._can_render = True

    def of(self, result: ModelResult) -> Iterator[PageCard]:
        """Yields a card for each finding of a model, the worst first."""
        model = self._pictured(result)
        for finding in sorted(result.findings, key=lambda each: -SEVERITIES.index(each.severity)):
            place = finding.file + (f":{finding.line}" if finding.line else "")
            image = self._picture(model, finding) if model else b""
            yield PageCard(
                f"{finding.code} {RULES[finding.code].title}",
                finding.severity,
                tuple(filter(None, (clean(place), clean(finding.object)))),
                (clean(finding.message), *(clean(line) for line in finding.remedy.splitlines())),
                data_uri(image) if image else "",
            )

    def _pictured(self, result: ModelResult) -> PicturedModel | None:
        if not (result.loads and result.findings and self._can_render and self._pictures < MAX_PICTURES):
            return None
        try:
            return PicturedModel(result.model)
        except ModelError:  # changed since, or a task
            return None

    def _picture(self, model: PicturedModel, finding: Finding) -> bytes:
        if not self._can_render or self._pictures >= MAX_PICTURES:
            return b""
        try:
            image = model.picture(finding)
        except NoRendererError as error:
            self._reporter.warn(f"the page has no pictures: {str(error).partition(chr(10))[0]}")
            self._can_render = False
            return b""
        self._pictures += bool(image)
        return image


def write_check_page(path: str, result: CheckResult, summary: str, reporter: Reporter) -> None:
    """Writes the page.

    Raises:
      BadValueError: `path` does not end with .html.
      FileError: the page cannot be written.
    """
    cards, makers = list[PageCard](), FindingCards(reporter)
    for model in worst_first(result.models):
        if len(cards) < MAX_CARDS:
            cards += makers.of(model)
    found = sum(len(model.findings) for model in result.models)
    notes = [summary] + ([f"{counted(found - MAX_CARDS, 'more finding')} …"] if found > MAX_CARDS else [])
    page = Page(
        "Check of models", MAKER, cards=cards[:MAX_CARDS], facts=[_models(result)] if found else [], notes=notes
    )
    with PageWriter(path) as writer:
        writer.write(page)
        writer.publish()


def _models(result: CheckResult) -> PageFacts:
    rows: list[tuple[str, ...]] = []
    faulty = [model for model in worst_first(result.models) if model.findings or not model.loads]
    for model in faulty[:MAX_CARDS]:
        counts = [str(model.count(severity) or "") for severity in reversed(SEVERITIES)]
        rows.append((clean(model.model), *counts, "" if model.loads else "does not load"))
    return PageFacts(
        "Models", "Models with findings, the worst first", ("Model", "Errors", "Warnings", "Notes", ""), rows, (1, 2, 3)
    )
