"""The last run that made the same outputs: it is not repeated while everything that they depend on is unchanged.

What a run depends on, the files that it made and its report are stored in the user's cache folder.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

from mjrun.confinement.confinement import confinement
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, option
from mjrun.file_version import file_version
from mjrun.formats.input_file import is_file
from mjrun.formats.manifest import fingerprint
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.formats.table_reader import STDIN
from mjrun.formats.user_cache import FileDigestCache, UserCache, program_facts
from mjrun.options.output import RerunOptions
from mjrun.outputs.output import OutputRequest, OutputResult
from mjrun.outputs.perform import PublishedOutput
from mjrun.packages import installed_versions
from mjrun.python_code import code_hash, module_sources
from mjrun.simulation.origin import plain
from mjrun.version import __version__

# Variables of the environment that choose tools, also for the drivers of OpenGL and Vulkan.
VARIABLES = (
    "MUJOCO_GL",
    "MUJOCO_EGL_DEVICE_ID",
    "IMAGEIO_FFMPEG_EXE",
    "GALLIUM_DRIVER",
    "LIBGL_ALWAYS_SOFTWARE",
    "LIBGL_DRIVERS_PATH",
    "MESA_LOADER_DRIVER_OVERRIDE",
    "__EGL_VENDOR_LIBRARY_FILENAMES",
    "VK_DRIVER_FILES",
    "VK_ICD_FILENAMES",
)
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # one that is set is a further backend; its number changes with the session
INCIDENTAL = ("command", "jobs")  # options that do not change an output
NAMED = 3  # outputs that a message names

Facts = dict[str, Any]


@dataclass(frozen=True)
class EarlierReport:
    """The report of the run that made the outputs.

    Attributes:
      outputs: the files that it made.
      document: its JSON document.
      cases: its verdicts.
    """

    outputs: Sequence[str]
    document: Mapping[str, object]
    cases: Sequence[Mapping[str, Any]]

    @property
    def sentence(self) -> str:
        names = [clean(path) for path in self.outputs]
        if len(names) > NAMED + 1:
            names[NAMED:] = [f"{len(names) - NAMED} more"]
        *first, last = names
        return f"{', '.join(first)} and {last}: up to date" if first else f"{last}: up to date"


class UpToDateCheck:
    """A check of a run against the last one that made the same outputs; a context manager.

    Args:
      requests: the outputs, which share one simulation.
      options: whether the run is omitted if nothing has changed, and the file for the build system.
      documents: the documents that the outputs are described in.
      page: the page about the outputs, if any.

    Attributes:
      reason: why the outputs are made again; empty for the first time, and before `up_to_date` is called.

    Raises:
      UsageError: the outputs do not allow these options.
      FileError: the file for the build system cannot be written.
    """

    def __init__(
        self,
        requests: Sequence[OutputRequest[OutputResult]],
        options: RerunOptions,
        documents: Sequence[Path | str] = (),
        page: str | None = None,
    ) -> None:
        self.reason = ""
        self._requests, self._options, self._documents, self._page = requests, options, documents, page
        self._stack, self._facts = ExitStack(), dict[str, Any]()
        self._versions = dict[str, list[int] | None]()  # of the files that are read, before they are
        self._digests, self._entries = FileDigestCache(), UserCache("run")
        self._check()
        depfile = options.depfile
        self._writer = self._stack.enter_context(OutputWriter(StagedFile(Path(depfile)))) if depfile else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def up_to_date(self) -> EarlierReport | None:
        """Returns the earlier report if it still describes the outputs; None if they have to be made."""
        if not self._options.if_changed:
            return None
        self._versions = self._present_versions()
        self._facts = self._present_facts()
        entry = self._entries.read(self._key)
        if entry is None:
            return None
        self.reason = next(_changes(entry["facts"], self._facts), "") or next(self._damages(entry["outputs"]), "")
        if self.reason:
            return None
        self._publish_dependencies()
        return EarlierReport([output["path"] for output in entry["outputs"]], entry["document"], entry["cases"])

    def finish(
        self,
        published: Sequence[PublishedOutput],
        document: Callable[[], Mapping[str, object]],
        cases: Callable[[], Iterable[object]] = tuple[object],
    ) -> str:
        """Stores the report of a complete run and what it depends on, unless a file has changed meanwhile.

        Args:
          published: the outputs that were made.
          document: makes the JSON document of the report.
          cases: makes its verdicts, dataclasses.

        Returns:
          Why nothing was stored, which the user should know; empty if stored, or if the run itself writes an input.
        """
        self._publish_dependencies()
        if not self._options.if_changed:
            return ""
        if reason := next(self._replaced_inputs(), "") or next(_replaced_outputs(published), ""):
            return reason
        if self._facts != self._present_facts():
            return ""

        more = [path for path in self._outputs if is_file(path)]  # manifests, and the page
        made = [file for output in published for file in output.files]
        outputs = [fingerprint(path) for path in dict.fromkeys([*made, *map(Path, more)])]
        if reason := next(_replaced_outputs(published), ""):  # while it was hashed
            return reason
        verdicts = [asdict(cast(Any, case)) for case in cases()]
        entry = {"facts": self._facts, "outputs": outputs, "document": document(), "cases": verdicts}
        self._entries.write(self._key, entry)
        self._entries.trim()
        return ""

    @property
    def _key(self) -> str:
        """The name of the entry: a hash of the files that are written, and of the version, which decides its form."""
        names = "\0".join([__version__, str(Path.cwd()), *self._outputs])
        return hashlib.sha256(names.encode(errors="surrogateescape")).hexdigest()

    @property
    def _outputs(self) -> list[str]:
        """The files and folders that are written, each once."""
        files = [path for request in self._requests for _, path in request.files]
        return list(dict.fromkeys([*files, *([self._page] if self._page else [])]))

    def _check(self) -> None:
        names = [name for name in ("if_changed", "depfile") if getattr(self._options, name)]
        if not names:
            return
        what = option(names[0])
        if confinement() is not None:
            reason = "a confined run keeps no record"
            raise UsageError(f"{what} and {option('untrusted')} exclude each other: {reason}")
        if STDIN in self._outputs:
            raise UsageError(f"{what} requires files, not standard output; write to one with {option('output')}")
        if self._requests[0].simulation.model == STDIN:
            raise UsageError(f"{what} requires a model in a file, not on standard input")
        written = self._options.depfile and os.path.realpath(self._options.depfile)
        if written and written in map(os.path.realpath, [*self._outputs, *self._inputs()]):
            raise UsageError(f"{option('depfile')} {clean(str(self._options.depfile))} is another file of this run")

    def _inputs(self) -> list[str]:
        """Returns the files that are read, each once, without those of code."""
        paths = [str(path) for _, path in self._requests[0].simulation.inputs]
        paths += [path for request in self._requests for _, path in request.inputs]
        return list(dict.fromkeys(os.path.normpath(path) for path in [*map(str, self._documents), *paths]))

    def _code(self) -> list[object]:
        """Returns the functions and objects that the user has written, each once."""
        return [*{id(part): part for request in self._requests for part in request.code}.values()]

    def _present_facts(self) -> Facts:
        """Returns everything that the outputs depend on, as plain values for JSON."""
        simulation = self._requests[0].simulation
        facts = {
            "files": {path: self._digests.of(path) for path in self._inputs()},
            "options": [_options(request) for request in self._requests],
            "page": self._page,
            "code": code_hash(self._code()),
            "environment": [
                simulation.source.code,
                *(os.environ.get(name) for name in VARIABLES),
                any(os.environ.get(name) for name in DISPLAYS),
            ],
            "versions": installed_versions(),
            "program": program_facts(),
        }
        return json.loads(json.dumps(facts))

    def _present_versions(self) -> dict[str, list[int] | None]:
        return {path: file_version(path) for path in self._inputs()}

    def _replaced_inputs(self) -> Iterator[str]:
        """Yields a sentence about each input that another process has changed, even if its content is restored."""
        own = {os.path.realpath(path) for request in self._requests for path in request.rewritten_inputs}
        present = self._present_versions()
        for path in dict.fromkeys([*self._versions, *present]):
            if self._versions.get(path) != present.get(path) and os.path.realpath(path) not in own:
                yield f"{clean(path)} was replaced or changed during the run"

    def _damages(self, outputs: Sequence[Mapping[str, Any]]) -> Iterator[str]:
        """Yields a sentence about each output that is not as it was made."""
        for output in outputs:
            digest = self._digests.of(output["path"])
            if digest != output["sha256"]:
                yield f"{clean(output['path'])} {'has changed' if digest else 'is missing'}"

    def _publish_dependencies(self) -> None:
        """Writes the file for the build system, unless it has this content already."""
        if self._writer is None:
            return
        code = [source.path for source in module_sources(self._code())]
        content = dependencies(self._outputs, [*self._inputs(), *code]).encode(errors="surrogateescape")
        target = Path(str(self._options.depfile))
        if not target.is_file() or target.read_bytes() != content:
            self._writer.write_file(content)
            self._writer.publish()


def dependencies(outputs: Sequence[str], inputs: Sequence[str]) -> str:
    """Returns the rule of a makefile by which `outputs` depend on `inputs`, as compilers write it.

    Each input is a target without a rule as well, so that make does not miss one that is removed.
    """
    targets = " ".join(_escaped(path.rstrip("/")) for path in outputs)
    sources = [_escaped(path) for path in inputs]
    rule = " \\\n  ".join([f"{targets}:", *sources])
    return "\n".join([rule, *(f"{source}:" for source in sources), ""])


def _escaped(path: str) -> str:
    for character in (" ", "#"):
        path = path.replace(character, f"\\{character}")
    return path.replace("$", "$$")


def _replaced_outputs(published: Sequence[PublishedOutput]) -> Iterator[str]:
    """Yields a sentence about each file that is no longer the published one, as after a run with other options."""
    for path, version in (each for output in published for each in output.file_versions.items()):
        if file_version(str(path)) != version:
            yield f"{clean(str(path))} was replaced or changed by another process"


def _options(request: OutputRequest[OutputResult]) -> object:
    options = cast(Facts, plain(request))
    return {name: value for name, value in options.items() if name not in INCIDENTAL}


def _changes(before: Facts, after: Facts) -> Iterator[str]:
    """Yields sentences about the differences between the facts of two runs, the most telling first."""
    left = {digest: path for path, digest in before["files"].items() if digest and path not in after["files"]}
    for path in dict.fromkeys([*after["files"], *before["files"]]):
        old, new = before["files"].get(path), after["files"].get(path)
        if old is None and new in left:
            yield f"{clean(path)} is read instead of {clean(left[new])}"
        elif old != new:
            what = "may be read now" if old is None else "is no longer read" if new is None else "has changed"
            yield f"{clean(path)} {what}"
    if before["code"] != after["code"]:
        yield "the code of the controller or policy has changed"
    if [before["options"], before["page"]] != [after["options"], after["page"]]:
        yield "the options have changed"
    for package, version in after["versions"].items():
        if version != before["versions"].get(package):
            yield f"{package} is {version or 'missing'} now, and was {before['versions'].get(package) or 'missing'}"
    if before != after:
        yield "mjrun or its environment has changed"
