"""Writing of pages about results, and the files that they include."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import cast

from mjrun.errors import BadValueError, clean, concerning, file_errors, option
from mjrun.formats.destinations import StagedFile
from mjrun.formats.input_file import parse_manifest
from mjrun.formats.manifest import fingerprint
from mjrun.formats.output_writer import OutputWriter
from mjrun.plotting.html_page import FileManifest, Page, ShownFile, html_page, page_file
from mjrun.probe.verdict import Verdict
from mjrun.suffixes import HTML
from mjrun.version import __version__

MAKER = f"mjrun {__version__}"


class PageWriter(OutputWriter):
    """A writer of one page. Opening it proves that the output can be written.

    Raises:
      BadValueError: the output does not end with .html.
      FileError: the output cannot be written.
    """

    def __init__(self, output: str) -> None:
        check_page_name(output)
        super().__init__(StagedFile(Path(output)))

    def write(self, page: Page) -> None:
        """Writes the page; the same page gives the same bytes.

        Raises:
          FileError: the page cannot be written.
        """
        self.write_file(html_page(page).encode())


def write_page(output: str, page: Page) -> None:
    """Writes and publishes a page.

    Raises:
      BadValueError: the output does not end with .html.
      FileError: it cannot be written.
    """
    with PageWriter(output) as writer:
        writer.write(page)
        writer.publish()


def check_page_name(output: str) -> None:
    """Raises BadValueError if `output` is not the name of a page."""
    if Path(output).suffix.lower() not in HTML:
        with concerning("html"):
            raise BadValueError(option("html"), output, "a file that ends with .html")


def included(paths: Iterable[str], page: str, limit: float) -> tuple[list[ShownFile], list[FileManifest]]:
    """Returns the files that a page at `page` shows, and the manifests among them.

    Args:
      limit: maximum size of an embedded file [MB].

    Raises:
      FileError: a file does not exist or cannot be read.
    """
    files: list[ShownFile] = []
    manifests: list[FileManifest] = []
    for path in paths:
        manifest = _manifest(path) if path.lower().endswith(".json") else None
        if manifest is None:
            files.append(page_file(path, page, limit))
        else:
            manifests.append(FileManifest(path, manifest))
    return files, manifests


def origin(title: str, command: str, inputs: Iterable[str], versions: Mapping[str, str]) -> FileManifest:
    """Returns how something was made: the command, the versions, and the hashes of the files that were read.

    Args:
      inputs: paths of the files; those that are not files, such as standard input, are omitted.
      versions: versions of libraries in addition to mjrun, by name.
    """
    files = [{**fingerprint(Path(path)), "path": clean(path)} for path in dict.fromkeys(inputs) if Path(path).is_file()]
    return FileManifest(title, {"command": command, "mjrun": __version__, **versions, "inputs": files})


def recorded_verdicts(manifests: Iterable[FileManifest]) -> list[tuple[str, Verdict]]:
    """Returns the verdicts of assertions in manifests, each with its file."""
    verdicts: list[tuple[str, Verdict]] = []
    for manifest in manifests:
        result = manifest.content.get("result")
        if not isinstance(result, Mapping):
            continue
        facts = cast(Mapping[str, object], result)
        entries = facts.get("assertions")
        for entry in cast(Sequence[object], entries) if isinstance(entries, list) else ():
            match entry:
                case {"text": str(text), "passed": bool(passed), "message": str(message)}:
                    verdicts.append((str(facts.get("path", manifest.path)), Verdict(text, passed, message)))
                case _:
                    pass
    return verdicts


def _manifest(path: str) -> dict[str, object] | None:
    """Returns the content of a JSON document if it is an mjrun manifest."""
    with file_errors(path):
        content = parse_manifest(Path(path).read_bytes())
    return content if content and "mjrun" in content else None
