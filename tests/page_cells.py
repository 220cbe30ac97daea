"""The texts in the tables of a page."""

from html.parser import HTMLParser


class PageCells(HTMLParser):
    """The texts of all cells of the tables of a page.

    Attributes:
      texts: in order.
    """

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self._is_inside = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("td", "th"):
            self.texts.append("")
            self._is_inside = True

    def handle_endtag(self, tag: str) -> None:
        self._is_inside = self._is_inside and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._is_inside:
            self.texts[-1] += data

    def numbers_after(self, text: str, count: int) -> list[float]:
        """Returns the numbers in the cells after the first one with this text."""
        start = self.texts.index(text) + 1
        return [float(cell.replace("−", "-").replace(",", "")) for cell in self.texts[start : start + count]]
