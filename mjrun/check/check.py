"""`mjrun check`: checks models for faults, each in a separate process."""

import itertools
import os
import shlex
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeVar

from mjrun.check.finding import SEVERITIES, Finding, Fix, FixedFile, FixedModelCopy, FixResult, ModelCheckResult
from mjrun.check.rule_catalogue import codes, matching_codes, threshold_values
from mjrun.check.rules.check_itself import CRASH, INTERNAL_ERROR, NOT_FIXED, OUT_OF_MEMORY, TIMEOUT
from mjrun.check.worker_pool import (
    FIX_TIME,
    MEMORY_REMEDY,
    CheckProcessOutput,
    CheckProcessPool,
    CheckQueue,
    CheckRequest,
)
from mjrun.child_process import ExitStatus
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, FileError, Spelling, UsageError, clean, option, spelled
from mjrun.formats.input_file import files_below, is_file, is_folder
from mjrun.model.xml_source import scan
from mjrun.options.check import EXTRAS, CheckOptions
from mjrun.options.number_kinds import AUTO
from mjrun.options.option import OptionRequirement, options
from mjrun.options.policy import NORMALIZE_REQUIREMENT, PolicyOptions
from mjrun.packages import core_versions, installed_version
from mjrun.platform.cores import available_cores
from mjrun.platform.mirrored_paths import with_original_paths
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.suffixes import ARCHIVES, CHECKED, COMPILED, XML, is_yaml
from mjrun.version import __version__

if TYPE_CHECKING:
    from mjrun.check.baseline import Baseline
    from mjrun.check.fixing import BeforeFix, ModelFixer
    from mjrun.check.result_cache import ResultCache

T = TypeVar("T")

CRASH_REMEDY = "MuJoCo crashes on thousands of nested elements, SDF plugins of infinite size, and damaged .mjb files"
HEAD = 2**16  # bytes that must contain the start of the root of an XML file
START = 2**10  # bytes that mostly do
ROOTS = {"mujoco", "robot"}
TEXT_ONLY = f"{option('fix')} changes the text of MJCF, not that of URDF, archives and compiled models"
FRAGMENT = "mujocoinclude"  # the root of a file that other models include


@dataclass(frozen=True)
class CheckResult:
    """The result of a check: those of all models, in the order given.

    Attributes:
      mjrun: the version that checked them.
      models: the result for each model.
      skipped: the number of files that are not models by themselves, such as files that models include.
      gone: the number of findings in the baseline that are no longer there.
      unchanged: the number of models that were not checked, as they have not changed since a commit.
      fixed: the files that were fixed, or would be in a dry run; the findings are those after that.
      written: true if they were written.
      code: the exit code: 7 if a fix cannot be written; 3 if a model does not load, unless that is known; 1 if a
        finding is at or above `fail_on`, or a dry run would fix something; else 0.
      errors, warnings, notes: the number of findings of each severity.
    """

    mjrun: str = field(default=__version__, kw_only=True)
    models: tuple[ModelCheckResult, ...]
    skipped: int
    code: int
    gone: int = 0
    unchanged: int = 0
    fixed: tuple[FixedFile, ...] = ()
    written: bool = False
    errors: int = field(default=0, init=False)
    warnings: int = field(default=0, init=False)
    notes: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        for severity in SEVERITIES:
            object.__setattr__(self, f"{severity}s", self.count(severity))

    def count(self, severity: str) -> int:
        """Returns the number of findings of this severity."""
        return sum(model.count(severity) for model in self.models)


@options
class ModelCheck(PolicyOptions, CheckOptions):
    """A check of models for errors, and for likely future ones.

    Args:
      models: files, and folders, which represent all models below them.

    Attributes:
      task_reader: the function that reads task documents, `package.module:name`; empty for none.

    Raises:
      UsageError: a code, severity or number is invalid.
    """

    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        NORMALIZE_REQUIREMENT,
        OptionRequirement("dry_run", "fix", "whose changes it counts"),
        OptionRequirement("update_baseline", "baseline", "which it replaces"),
    )
    task_reader: ClassVar[str] = ""

    models: Sequence[str | Path] = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.codes, self._ignored_codes, self._thresholds
        for code, severity in self.severity:
            matching_codes([code])
            if severity not in SEVERITIES:
                raise BadValueError(option("severity"), f"{code}={severity}", f"one of {', '.join(SEVERITIES)}")
        if self.update_baseline and self.changed_since is not None:
            reason = "a baseline contains the findings of all models"
            raise UsageError(f"{option('update_baseline')} excludes {option('changed_since')}: {reason}")
        if self.policy is not None and not isinstance(self.policy, str):
            raise UsageError(f"{option('policy')}: each task is checked in a separate process; give the policy as text")

    @cached_property
    def codes(self) -> frozenset[str]:
        """The codes of the rules to apply."""
        selected = matching_codes(self.select) if self.select else frozenset(codes())
        return selected - matching_codes(self.ignore)

    @cached_property
    def _thresholds(self) -> Mapping[str, float]:
        """The thresholds that differ from the defaults."""
        return threshold_values(self.threshold)

    @cached_property
    def _ignored_codes(self) -> list[tuple[str, frozenset[str]]]:
        """The patterns of files, and the codes to ignore in each."""
        return [
            (os.path.abspath(pattern), matching_codes(codes.replace(",", " ").split()))  # noqa: PTH100
            for pattern, codes in self.ignore_in
        ]

    @cached_property
    def _accepted(self) -> "Baseline | None":
        """The baseline with findings that are not to be fixed."""
        return self._known_findings() if self.fix else None

    def _known_findings(self) -> "Baseline | None":
        """Reads the baseline; None without one, or if it is to be written."""
        if self.baseline is None:
            return None
        from mjrun.check.baseline import Baseline, require_baseline

        if self.update_baseline:
            require_baseline(Path(self.baseline))
            return None
        return Baseline.read(Path(self.baseline))

    def run(
        self,
        reporter: Reporter | None = None,
        spelling: Spelling = str,
        finished: Callable[[ModelCheckResult], object] = lambda result: None,
        before_fix: "BeforeFix | None" = None,
    ) -> CheckResult:
        """Checks all models.

        Args:
          reporter: the reporter of the progress.
          spelling: the spelling of mjrun's options in remedies.
          finished: a function called with each result as soon as the model is checked, and fixed if it is to be.
          before_fix: a function called with the copy of each model that is fixed, or would be, and its findings that
            are, before the model is replaced.

        Raises:
          UsageError: `models` are folders without any model.
          FileError: one of them is a folder that cannot be read.
        """
        reporter = reporter or PythonApiReporter()
        known = self._known_findings()
        paths, skipped = find_models(self.models, skip_other=self.skip_other, warn=reporter.warn)
        if not paths and all(is_folder(path) for path in self.models):
            raise UsageError("no model to check: give model files, or folders that contain some")
        found = len(paths)
        if self.changed_since is not None:
            from mjrun.check.baseline import ChangedModels

            paths = ChangedModels(self.changed_since).of(paths)

        def reported(result: ModelCheckResult) -> ModelCheckResult:
            new = result if known is None else _without_known(result, known)
            finished(new)
            return new

        workers, cache = CheckProcessPool(reporter.note), self._result_cache()
        try:
            fixing = self._fixing(paths, workers, spelling, before_fix)
            count = itertools.count(1)

            def checked(each: FixResult) -> ModelCheckResult:
                reporter.progress("models", next(count), len(paths))
                return each.result if fixing else reported(each.result)

            results = self._check_all([self._task(path) for path in paths], workers, cache, spelling, checked)
            if fixing:
                fixed = fixing.fixed(results, dry_run=self.dry_run)
                results = [reported(_in_spelling(result, spelling)) for result in fixed]
        finally:
            workers.end()
            if cache:
                cache.entries.trim()

        if self.baseline is not None and known is None:
            from mjrun.check.baseline import Baseline, write_baseline

            write_baseline(Path(self.baseline), (finding for result in results for finding in result.findings))
            known = Baseline.read(Path(self.baseline))
            results = [_without_known(result, known) for result in results]
        gone = 0 if known is None else known.gone([result.model for result in results], self.codes)
        files = tuple(fixing.files) if fixing else ()
        code = self._exit_code(results) or int(self.dry_run and bool(files))
        if fixing and fixing.has_failed:
            code = FileError.exit_code
        written = bool(files) and not self.dry_run
        return CheckResult(tuple(results), skipped, code, gone, found - len(paths), files, written)

    def _result_cache(self) -> "ResultCache | None":
        """Returns the cache of results for the present versions of the packages that they depend on."""
        if not self.cache:
            return None
        from mjrun.check.result_cache import ResultCache

        libraries = [name for libraries, _ in EXTRAS.values() for name in libraries] if self.unsafe_fixes else []
        return ResultCache(core_versions() | {name: installed_version(name) for name in libraries})

    def _fixing(
        self, paths: Sequence[str], workers: CheckProcessPool, spelling: Spelling, before: "BeforeFix | None"
    ) -> "ModelFixer | None":
        """Returns the fixes of models, which are checked by `workers`; None without any."""
        if not self.fix:
            return None
        from mjrun.check.fixing import ModelFixer  # which imports MuJoCo

        def check(copies: Sequence[FixedModelCopy]) -> Sequence[FixResult]:
            tasks = [
                replace(self._task(copy.model), path=str(copy.path), root=str(copy.root), original=str(copy.original))
                for copy in copies
            ]
            return self._check_all(tasks, workers, None, spelling, lambda checked: checked)

        return ModelFixer(self.models, paths, check, before)

    def _check_all(
        self,
        tasks: Sequence[CheckRequest],
        workers: CheckProcessPool,
        cache: "ResultCache | None",
        spelling: Spelling,
        finished: Callable[[FixResult], T],
    ) -> list[T]:
        """Returns `finished` of each result, in the order of `tasks`; it is called as soon as the result is known.

        Several tasks are executed at once.
        """
        workers.left = len(tasks)
        jobs = min(available_cores() if self.jobs == AUTO else int(self.jobs), len(tasks))
        if jobs <= 1:
            return [finished(self._check(task, workers, cache, spelling)) for task in tasks]
        from concurrent.futures import ThreadPoolExecutor, as_completed  # slow to import

        queue = CheckQueue(tasks)

        def check_next() -> tuple[int, FixResult]:
            place, task = queue.take()
            return place, self._check(task, workers, cache, spelling)

        with ThreadPoolExecutor(jobs) as threads:
            try:
                futures = [threads.submit(check_next) for _ in tasks]
                checked = (future.result() for future in as_completed(futures))
                results = {place: finished(outcome) for place, outcome in checked}
                return [results[i] for i in range(len(tasks))]
            except BaseException:
                workers.end()
                raise
            finally:
                threads.shutdown(cancel_futures=True)

    def _check(
        self, task: CheckRequest, workers: CheckProcessPool, cache: "ResultCache | None", spelling: Spelling
    ) -> FixResult:
        output = self._output(task, workers, cache)
        is_done = any(message.get("done") for message in output.messages)
        if task.unsafe and not is_done:
            checked = self._check(replace(task, unsafe=False), workers, cache, spelling)
            return _without_unsafe(checked, self._failure(Path(task.model), output), spelling)
        findings = [Finding.read(message["finding"]) for message in output.messages if "finding" in message]
        loads = any(message.get("loaded") for message in output.messages)
        if not is_done:
            findings.append(self._failure(Path(task.path), output))
            loads = False
        loads = loads and all(finding.code != OUT_OF_MEMORY.code for finding in findings)

        reported: list[Finding] = []
        for finding in (_of_original(finding, task) for finding in findings):
            if finding.severity == "error" and not loads:  # always reported unchanged
                reported.append(finding)
            elif finding.code in self.codes and not self._is_ignored(finding):
                reported.append(replace(finding, severity=self._severity(finding)))

        if self.fix:
            reported = [_with_reason(each, Path(task.model)) for each in reported]
        if self._accepted:
            reported = [replace(each, fixes=()) if self._accepted.contains(each) else each for each in reported]
        suppressed = sum(message.get("suppressed", 0) for message in output.messages)
        result = _in_spelling(ModelCheckResult(task.model, loads, tuple(reported), suppressed), spelling)
        changes = next((message["changes"] for message in output.messages if "changes" in message), None)
        return FixResult(result, changes)

    @staticmethod
    def _output(task: CheckRequest, workers: CheckProcessPool, cache: "ResultCache | None") -> CheckProcessOutput:
        """Returns the output of the check of one model, or an earlier one."""
        if cache is None:
            return workers.run(task)
        key, began = cache.key(task), time.time_ns()
        messages = cache.read(key)
        if messages is not None:
            return CheckProcessOutput(messages, ExitStatus(0), "")
        output = workers.run(task)
        cache.write(key, task, output.messages, began)
        return output

    def _is_ignored(self, finding: Finding) -> bool:
        """Returns whether `ignore_in` excludes a finding."""
        file = os.path.abspath(finding.file)  # noqa: PTH100
        return any(fnmatchcase(file, pattern) and finding.code in codes for pattern, codes in self._ignored_codes)

    def _severity(self, finding: Finding) -> str:
        """Returns the severity of a finding; of several codes in `severity` that match, the longest applies."""
        matching = [(len(code), severity) for code, severity in self.severity if finding.code.startswith(code.upper())]
        return max(matching)[1] if matching else finding.severity

    def _task(self, path: str) -> CheckRequest:
        limits = CheckRequest(path, sorted(self.codes), self.steps, float(self.timeout), self.memory)
        limits = replace(limits, model=path, unsafe=self.unsafe_fixes, cache=self.cache, thresholds=self._thresholds)
        if not self.task_reader or not is_yaml(path):
            return limits
        policy = "" if self.policy is None else str(self.policy)
        return replace(limits, reader=self.task_reader, policy=policy, normalize=self.normalize, trust=self.trust)

    def _failure(self, model: Path, output: CheckProcessOutput) -> Finding:
        """Returns a finding that explains why a process ended prematurely."""
        stages = [message["stage"] for message in output.messages if "stage" in message]
        stage = stages[-1] if stages else "starting"
        ended = output.exit
        if ended.cause == "memory" or "bad_alloc" in output.stderr or "MemoryError" in output.stderr:
            message = f"it needs more than {self.memory} MiB of memory while {stage}"
            return OUT_OF_MEMORY.in_model(model, message, MEMORY_REMEDY)
        if ended.cause:
            is_slow = any(message.get("is_slow") for message in output.messages)
            message = f"not finished after {float(self.timeout) + FIX_TIME * is_slow:g} s, while {stage}"
            remedy = f"raise {option('timeout')}, or lower {option('steps')}; a pipe among its files never ends"
            return TIMEOUT.in_model(model, message, remedy)

        reason = output.stderr.strip().rpartition("\n")[2]
        detail = f": {reason}" if reason else ""
        if ended.signal:
            message = f"its process was killed by {ended.signal} while {stage}{detail}"
            return CRASH.in_model(model, message, CRASH_REMEDY)
        return INTERNAL_ERROR.in_model(model, f"mjrun failed while {stage}{detail}", "please report it")

    def _exit_code(self, results: Sequence[ModelCheckResult]) -> int:
        if any(not (result.loads or _is_known_not_to_load(result)) for result in results):
            return 3
        least = SEVERITIES.index(self.fail_on)
        return int(any(SEVERITIES.index(f.severity) >= least for result in results for f in result.findings))


def _without_known(result: ModelCheckResult, known: "Baseline") -> ModelCheckResult:
    """Returns a result without the findings of a baseline."""
    new = known.new(result.findings)
    return replace(result, findings=new, known=len(result.findings) - len(new))


def worst_first(models: Iterable[ModelCheckResult]) -> list[ModelCheckResult]:
    """Returns models that do not load first, then by their numbers of errors, warnings and notes."""

    def badness(model: ModelCheckResult) -> tuple[int, ...]:
        return (not model.loads, *(model.count(severity) for severity in reversed(SEVERITIES)))

    return sorted(models, key=badness, reverse=True)


def _is_known_not_to_load(result: ModelCheckResult) -> bool:
    return result.known > 0 and all(finding.severity != "error" for finding in result.findings)


def _without_unsafe(checked: FixResult, failure: Finding, spelling: Spelling) -> FixResult:
    """Returns a model that was checked without unsafe fixes, with their failure as the reason if that succeeded."""
    message = f"{option('unsafe_fixes')} is left out: {failure.message}"
    reason = NOT_FIXED.in_model(Path(failure.file), message, failure.remedy)
    result = replace(checked.result, findings=(*checked.result.findings, reason))
    return checked._replace(result=_in_spelling(result, spelling)) if checked.result.loads else checked


def _with_reason(finding: Finding, model: Path) -> Finding:
    """Returns a finding whose remedy states why it is not fixed, if it might be expected to be."""
    if not finding.unfixed or finding.fixes:
        return finding
    reason = TEXT_ONLY if model.suffix in (".urdf", *ARCHIVES, *COMPILED) else finding.unfixed
    return replace(finding, remedy=f"{finding.remedy}\nnot fixed: {reason}".lstrip("\n"))


def _in_spelling(result: ModelCheckResult, spelling: Spelling) -> ModelCheckResult:
    """Returns a result in whose texts mjrun's options are spelled."""
    texts = ((each, spelled(each.message, spelling), spelled(each.remedy, spelling)) for each in result.findings)
    return replace(result, findings=tuple(replace(each, message=one, remedy=two) for each, one, two in texts))


def _of_original(finding: Finding, task: CheckRequest) -> Finding:
    """Returns a finding in a copy as one in the original."""
    if not task.root:
        return finding
    here = Path(os.devnull) if Path(task.model).is_absolute() else Path.cwd()

    def original(text: str) -> str:
        return with_original_paths(text, Path(task.root), here)

    fixes = [
        Fix(tuple(replace(e, file=original(e.file)) for e in fix.edits), fix.changes, tuple(map(original, fix.files)))
        for fix in finding.fixes
    ]
    texts = {name: original(getattr(finding, name)) for name in ("message", "file", "remedy")}
    return replace(finding, **texts, fixes=tuple(fixes))


def find_models(
    paths: Sequence[str | Path], *, skip_other: bool = False, warn: Callable[[str], object] = lambda text: None
) -> tuple[list[str], int]:
    """Returns the models among files and folders, each once and in order, and the number of files that are not models.

    The latter are files in folders whose root element is not that of a model, and parts that models include. Links to
    a file are separate models, as they may be in folders with other files.

    Args:
      skip_other: Whether files given by name are not models either if their root element is another one.
      warn: a function called with a sentence about each folder in a folder that cannot be read.

    Raises:
      FileError: one of `paths` is a folder that cannot be read.
    """
    models: dict[str, str] = {}  # by the real path of the folder, and the name in it
    skipped = 0

    def add(path: str) -> None:
        folder, name = os.path.split(path)
        models.setdefault(os.path.join(os.path.realpath(folder), name), path)  # noqa: PTH118

    def report(error: OSError) -> None:
        unread = FileError(str(error.filename), f"cannot be read: {error.strerror}")
        if error.filename in given:
            raise unread
        warn(f"{unread}; models in it are not checked")

    given = [_path(path) for path in paths]
    for path in given:
        if not is_folder(path):
            tag = root_tag(Path(path))
            if tag == FRAGMENT or (skip_other and tag not in ("", *ROOTS)):
                skipped += 1
            else:
                add(path)
            continue
        for file in files_below(Path(path), report):
            if not file.name.endswith(CHECKED):
                continue
            if file.suffix not in XML or _may_be_model(file):
                add(str(file))
            else:
                skipped += 1
    return list(models.values()), skipped


def _path(model: str | Path) -> str:
    """Returns the path of a model or a task; a name in a collection, such as `scene:dominos`, represents its file."""
    if ":" not in str(model) and str(model) != "-":
        return str(model)
    from mjrun.model.source import CollectionModelSource  # slow to import, like MuJoCo
    from mjrun.model.sources import demonstration_in, source_of
    from mjrun.model.sources.bundled_scene import bundled_task

    if task := bundled_task(str(model)):
        return str(task)
    source = source_of(model)
    if source.main_file is None:
        shown = clean(shlex.quote(source.text))
        advice = f"\n`mjrun info {shown} --xml > model.xml` writes one" if demonstration_in(source) else ""
        raise UsageError(f"{clean(str(model))}: a check needs a model file{advice}")
    return str(source.main_file if isinstance(source, CollectionModelSource) else model)


def root_tag(path: Path) -> str:
    """Returns the tag of the root element of an XML file; empty without one, or if the file is not a regular one."""
    with suppress(OSError):
        return _root_tag(_head(path))
    return ""


def _may_be_model(path: Path) -> bool:
    """Returns whether an XML file in a folder is a model, or one that cannot be read, which is to be reported."""
    try:
        head = _head(path)
    except OSError:
        return True
    tag = _root_tag(head)
    return tag in ROOTS if tag else b"<mujoco" in head  # after the markers of a conflict, for example


def _head(path: Path) -> bytes:
    """Returns the beginning of a file; nothing if it is not a regular one.

    Raises:
      OSError: it cannot be read.
    """
    if not is_file(path) and path.exists():
        return b""
    with path.open("rb") as file:
        return file.read(HEAD)


def _root_tag(head: bytes) -> str:
    tags: list[str] = []
    for text in (head[:START], head):
        scan(text, lambda tag, attributes, line: tags.append(tag))
        if tags:
            return tags[0]
    return ""
