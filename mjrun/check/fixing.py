"""Fixes of models: edits of their text that are tried on a mirror of their files before any file changes.

Models that share a file are fixed together. The edits that their findings propose are made on copies, in rounds, until
none is left. After each round, a model that loaded before must load, and differ only in what the fixes of that round
may change in it: named fields of named objects. The other fixes are left out. All files of these models are replaced
together with the files that fixes add, or none.
"""

import difflib
import os
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import mujoco

from mjrun.check.finding import Finding, Fix, FixedFile, FixedModelCopy, FixResult, ModelCheckResult, short_path
from mjrun.check.rules.check_itself import NOT_FIXED
from mjrun.confinement.confinement import is_within, is_writable
from mjrun.dataclass import dataclass
from mjrun.errors import FileError, ModelError, option
from mjrun.formats.input_file import is_folder
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import OutputWriter, publish_together
from mjrun.formats.temporary_output import scratch_folder
from mjrun.model.sources import CompiledSource, source_of
from mjrun.model.text_edits import TextEdit, disjoint, edited
from mjrun.model.xml_source import read_xml
from mjrun.platform import system
from mjrun.platform.mirrored_paths import mirrored
from mjrun.suffixes import XML

MAX_ROUNDS = 50
ROUNDING = 1e-9  # absolute and relative, of numbers that a fix writes in another way, with ten digits
RUN_AGAIN = "run the command again"
OUTSIDE = f"it is outside the folders of the models; give a folder that contains both, with {option('fix')}"
IN_COLLECTION = f"it belongs to a collection of models; copy its folder, and give that, with {option('fix')}"


BeforeFix = Callable[[FixedModelCopy, Sequence[Finding]], object]


@dataclass(eq=False)
class _Group:
    """Models that share files.

    Attributes:
      models: the paths of the models, as given.
      places: the real path of each XML file, by its absolute path as models spell it.
      texts: the bytes of each XML file, by its real path.
    """

    models: list[str]
    places: dict[Path, str]
    texts: dict[str, bytes]

    def read(self, file: str) -> None:
        """Adds the XML files that belong to `file`: a model, or a file that a fix lets a model read."""
        for path, text in read_xml(Path(file)).texts.items():
            self.places[path.absolute()] = real = os.path.realpath(path)
            self.texts.setdefault(real, text)


class _Proposal(NamedTuple):
    """A fix as findings propose it: one for all objects that inherit what it edits, if each has the fault.

    Attributes:
      code: the code of the rule.
      changes: the fields of objects that it may change, by model.
    """

    code: str
    fix: Fix
    changes: dict[str, set[tuple[str, str]]]

    @property
    def key(self) -> tuple[str, Fix]:
        """The identity of the fix in later rounds, in which its edits are at other places."""
        return self.code, replace(self.fix, edits=tuple(replace(edit, start=0, end=0) for edit in self.fix.edits))


class _Attempt(NamedTuple):
    """The outcome of fixes by some rules.

    Attributes:
      texts: the new bytes of each XML file, and those of new files, by its real path.
      fixes: the fixes that were made, each with the code of its rule.
      checked: the results for the models with these texts.
      problem: the reason why the fixes must not be made, with the model; empty without one.
      refused: the reasons why some fixes were left out.
    """

    texts: dict[str, bytes]
    fixes: list[tuple[str, Fix]]
    checked: Sequence[FixResult]
    problem: str = ""
    refused: Sequence[str] = ()

    @property
    def results(self) -> list[ModelCheckResult]:
        """The results for the models."""
        return [each.result for each in self.checked]


class ModelFixer:
    """A fixer of models, which reads their text at once and tries fixes on copies.

    Args:
      given: the files and folders that the user named.
      models: the models to fix, as given.
      check: checks copies of models, in their order.
      before: is called before files are replaced, if that is possible, or would be in a dry run: with the copy of each
        fixed model, and its findings that are fixed.

    Attributes:
      files: the files that were fixed, or would be in a dry run.
      has_failed: whether the system refused to write a file.
    """

    def __init__(
        self,
        given: Sequence[str | Path],
        models: Sequence[str],
        check: Callable[[Sequence[FixedModelCopy]], Sequence[FixResult]],
        before: BeforeFix | None = None,
    ) -> None:
        self._check, self._before = check, before
        named = [path for path in map(Path, given) if path.exists()]  # the models of a collection are not
        self._trees = {os.path.realpath(path if is_folder(path) else path.parent) for path in named}
        self._groups = _groups(models)
        self.files: list[FixedFile] = []
        self.has_failed = False

    def fixed(self, results: Sequence[ModelCheckResult], *, dry_run: bool) -> list[ModelCheckResult]:
        """Fixes the models, unless this is a dry run, and returns the results after that."""
        by_model = {result.model: result for result in results}
        for group in self._groups:
            own = [by_model[model] for model in group.models]
            if any(finding.fixes for result in own for finding in result.findings):
                by_model |= {result.model: result for result in self._fix(group, own, dry_run)}
        return [by_model[result.model] for result in results]

    def _fix(self, group: _Group, results: Sequence[ModelCheckResult], dry_run: bool) -> list[ModelCheckResult]:
        """Fixes models that share files, and returns the results for them."""
        outside = dict.fromkeys(file for file in _edited_files(results) if not self._is_inside(file))
        problems = _shown_once(group, dict.fromkeys(outside, OUTSIDE if self._trees else IN_COLLECTION))
        attempt, refused = self._proved(group, results)
        problems += [(group.models[0], problem) for problem in refused]

        changed = [file for file, text in attempt.texts.items() if text != (group.texts.get(file) or _now(file))]
        reasons = {} if dry_run else {file: _obstacle(file, file not in group.texts) for file in changed}
        obstacles = _shown_once(group, reasons)
        if changed and not obstacles and self._before:
            self._report(group, attempt, results, self._before)
        if changed and not obstacles and not dry_run:
            try:
                obstacles = list(_replace(group, attempt.texts))
            except FileError as error:
                obstacles, self.has_failed = [(group.models[0], str(error))], True
        if obstacles:
            attempt, changed = _Attempt(group.texts, [], [*map(FixResult, results)]), []
        self.files += [_fixed_file(group, attempt, file) for file in changed]
        return _with_problems(attempt.results, [*problems, *obstacles])

    @staticmethod
    def _report(group: _Group, attempt: _Attempt, results: Sequence[ModelCheckResult], before: BeforeFix) -> None:
        """Reports fixed models while both they and their copies exist."""
        fixed = {code for code, _ in attempt.fixes}
        with _Mirror(group) as mirror:
            mirror.write(attempt.texts, attempt.fixes)
            for copy, result in zip(mirror.copies(None), results, strict=True):
                before(copy, [finding for finding in result.findings if finding.fixes and finding.code in fixed])

    def _proved(self, group: _Group, results: Sequence[ModelCheckResult]) -> tuple[_Attempt, list[str]]:
        """Returns the fixes that pass the proof, all or those of some rules, and the reasons against the others."""
        best, accepted, problems = _Attempt(group.texts, [], [*map(FixResult, results)]), list[str](), list[str]()
        whole = self._attempt(group, results, None)
        if not whole.problem:
            return whole, [*whole.refused]
        codes = dict.fromkeys(code for code, _ in whole.fixes)
        for code in codes:
            attempt = self._attempt(group, results, {*accepted, code}) if len(codes) > 1 else whole
            if attempt.problem:
                problems.append(f"{code} is not fixed: {attempt.problem}")
            else:
                accepted.append(code)
                best = attempt
        return best, [*problems, *best.refused]

    def _attempt(self, group: _Group, results: Sequence[ModelCheckResult], codes: Collection[str] | None) -> _Attempt:
        """Fixes violations of some rules, or of all, in copies, until none is left."""
        state, refused = _Attempt(dict(group.texts), [], [*map(FixResult, results)]), dict[tuple[str, Fix], str]()
        with _Mirror(group) as before, _Mirror(group) as after:
            for _ in range(MAX_ROUNDS):
                proposed = self._proposed(state.checked, codes)
                wanted = {edits: proposal for edits, proposal in proposed.items() if proposal.key not in refused}
                chosen = list(disjoint(wanted))
                if _with_edits(state.texts, chosen) == state.texts:
                    is_done = not state.fixes or any(result.loads for result in state.results)
                    problem = "" if is_done else f"{results[0].model} would still not load"
                    reasons = [f"{code} is not fixed: {reason}" for (code, _), reason in refused.items()]
                    return state._replace(problem=problem, refused=[*dict.fromkeys(reasons)])
                before.write(group.texts | state.texts, state.fixes)
                state = self._round(group, state, [wanted[edits] for edits in chosen], refused, (before, after))
        return state._replace(problem=f"the fixes do not end after {MAX_ROUNDS} rounds; please report it")

    def _round(
        self,
        group: _Group,
        state: _Attempt,
        proposals: Sequence[_Proposal],
        refused: dict[tuple[str, Fix], str],
        mirrors: "tuple[_Mirror, _Mirror]",
    ) -> _Attempt:
        """Makes the fixes that pass the proof, and adds the others to `refused`; halves find these among many."""
        best, accepted, waiting = state, list[_Proposal](), [proposals]
        while waiting:
            part = waiting.pop()
            tried = self._tried(group, state, [*accepted, *part], mirrors)
            if not tried.problem:
                best = tried
                accepted += part
            elif len(part) == 1:
                refused[part[0].key] = tried.problem
            else:
                waiting += [part[len(part) // 2 :], part[: len(part) // 2]]
        return best

    def _tried(
        self, group: _Group, state: _Attempt, proposals: Sequence[_Proposal], mirrors: "tuple[_Mirror, _Mirror]"
    ) -> _Attempt:
        """Makes fixes in the second of two mirrors, and compares the models with those in the first."""
        before, after = mirrors
        fixes = [*state.fixes, *((proposal.code, proposal.fix) for proposal in proposals)]
        for file in _xml_files(fixes):
            group.read(file)
        texts = group.texts | _with_edits(state.texts, [_real_edits(proposal.fix) for proposal in proposals])
        after.write(texts, fixes)
        checked = self._check([*after.copies(before)])
        return _Attempt(texts, fixes, checked, _problem(state.results, checked, proposals))

    def _proposed(
        self, checked: Sequence[FixResult], codes: Collection[str] | None
    ) -> dict[tuple[TextEdit, ...], _Proposal]:
        """Returns the fixes that may be made, by their edits."""
        proposed: dict[tuple[TextEdit, ...], _Proposal] = {}
        for result, finding in ((each.result, finding) for each in checked for finding in each.result.findings):
            for fix in finding.fixes if codes is None or finding.code in codes else ():
                if all(self._is_inside(edit.file) for edit in fix.edits):
                    edits = _real_edits(fix)
                    changes = proposed[edits].changes if edits in proposed else {}
                    changes.setdefault(result.model, set()).update(fix.changes)
                    proposed[edits] = _Proposal(finding.code, fix, changes)
        return proposed

    def _is_inside(self, file: str) -> bool:
        """Returns whether a file is inside the folders that may be changed, after following links."""
        return any(is_within(os.path.realpath(file), tree) for tree in self._trees)


class _Mirror:
    """A folder with copies of the XML files of models, and links to the other files that they read."""

    def __init__(self, group: _Group) -> None:
        self._group, self._stack = group, ExitStack()
        self._root = self._stack.enter_context(scratch_folder())
        self._written: list[Path] = []

    def __enter__(self) -> "_Mirror":
        files = [file.absolute() for model in self._group.models for file in source_of(model).files]
        for file in dict.fromkeys([*self._group.places, *files]):
            self._add(file)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _add(self, file: Path) -> None:
        """Makes the folder of a file, and links the file unless it is one of the texts."""
        copy = mirrored(self._root, file)
        os.makedirs(copy.parent, exist_ok=True)  # noqa: PTH103 – with every part of a path such as a/../b
        if file in self._group.places:
            return
        try:
            copy.symlink_to(file)
        except FileExistsError:  # another spelling of the same path
            return
        except OSError:  # as in a confined process
            shutil.copyfile(file, copy)

    def write(self, texts: Mapping[str, bytes], fixes: Sequence[tuple[str, Fix]]) -> None:
        """Writes texts, given by real paths, to the places of these paths, and links the files that they read now."""
        assets = [Path(file) for _, fix in fixes for file in fix.files]
        for file in (*assets, *(file for xml in _xml_files(fixes) for file in source_of(xml).files)):
            self._add(file.absolute())
        for copy in self._written:  # also files of fixes that were left out
            copy.unlink(missing_ok=True)
        self._written.clear()
        for place, real in _places(self._group, fixes).items():
            copy = mirrored(self._root, place)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.unlink(missing_ok=True)  # a link leads to the original
            copy.write_bytes(texts[real])
            self._written.append(copy)

    def copies(self, original: "_Mirror | None") -> Iterator[FixedModelCopy]:
        """Yields the copies of the models, to be compared with those in another mirror, or with the models."""
        for model in self._group.models:
            path = Path(model).absolute()
            reference = mirrored(original._root, path) if original else Path(model)
            yield FixedModelCopy(model, mirrored(self._root, path), self._root, reference)


def changed_fields(original: Path, model: mujoco.MjModel) -> list[tuple[str, str]] | None:
    """Returns the fields in which a model differs from the original, each with its object; None without an original."""
    from mjrun.diff.models import compare_models
    from mjrun.diff.tolerances import Tolerance, Tolerances

    tolerances = Tolerances(Tolerance(atol=ROUNDING, rtol=ROUNDING), {})
    try:
        differences = compare_models(source_of(original), CompiledSource(model), tolerances)
    except ModelError:
        return None
    values = [(each.field, each.object) for each in (*differences.fields, *differences.arrays)]
    return values + [(each.kind, each.name) for each in (*differences.only_a, *differences.only_b)]


def _groups(models: Sequence[str]) -> list[_Group]:
    """Returns the models in groups that share no file."""
    groups: list[_Group] = []
    for model in models:
        own = _Group([model], {}, {})
        own.read(model)
        for other in [group for group in groups if not group.texts.keys().isdisjoint(own.texts)]:
            groups.remove(other)
            own = _Group([*other.models, *own.models], other.places | own.places, other.texts | own.texts)
        groups.append(own)
    return groups


def _edited_files(results: Sequence[ModelCheckResult]) -> Iterator[str]:
    for result in results:
        for finding in result.findings:
            yield from (os.path.realpath(edit.file) for fix in finding.fixes for edit in fix.edits)


def _real_edits(fix: Fix) -> tuple[TextEdit, ...]:
    return tuple(replace(edit, file=os.path.realpath(edit.file)) for edit in fix.edits)


def _places(group: _Group, fixes: Sequence[tuple[str, Fix]]) -> dict[Path, str]:
    """Returns the real path of each XML file and of each file that fixes create, by its absolute path."""
    return group.places | {Path(e.file).absolute(): os.path.realpath(e.file) for _, fix in fixes for e in fix.edits}


def _xml_files(fixes: Sequence[tuple[str, Fix]]) -> list[str]:
    """Returns the XML files that only the fixed models read."""
    return [file for _, fix in fixes for file in fix.files if Path(file).suffix in XML]


def _with_edits(texts: Mapping[str, bytes], groups: Sequence[tuple[TextEdit, ...]]) -> dict[str, bytes]:
    edits = dict.fromkeys(edit for group in groups for edit in group)
    files = dict.fromkeys([*texts, *(edit.file for edit in edits)])
    return {file: edited(texts.get(file, b""), [edit for edit in edits if edit.file == file]) for file in files}


def _problem(before: Sequence[ModelCheckResult], after: Sequence[FixResult], proposals: Sequence[_Proposal]) -> str:
    """Returns the reason why fixes must not be made; empty without one."""
    for old, (new, changes) in zip(before, after, strict=True):
        if old.loads and not new.loads:
            return f"{new.model} would no longer load"
        allowed = {change for proposal in proposals for change in proposal.changes.get(new.model, ())}
        for field, owner in changes or ():
            if not any(_covers(change, field, owner) for change in allowed):
                return f"it would also change {field} of {owner or 'the model'} in {new.model}"
    return ""


def _covers(change: tuple[str, str], field: str, owner: str) -> bool:
    """Returns whether a fix that may make a change may change a field of an object."""
    pattern, name = change
    old = owner.partition(" → ")[0]  # of an object that has another number now
    is_owner = old.startswith(name[:-1]) if name.endswith("*") else old == name
    return is_owner and fnmatchcase(field, pattern)


def _obstacle(file: str, is_new: bool) -> str:
    """Returns the reason why a file must not be replaced or created; empty without one."""
    path = Path(file)
    if not is_writable(file):
        return f"{option('untrusted')} does not allow to write it"
    if is_new and os.path.lexists(file):
        return "it exists already, with other content"
    if is_new:
        return "" if os.access(path.parent, os.W_OK) else "its folder is read-only or does not exist"
    if not (path.stat().st_mode & 0o222 and os.access(file, os.W_OK) and os.access(path.parent, os.W_OK)):
        return "it is read-only"
    editors = [name for name in (f".{path.name}.swp", f".#{path.name}") if os.path.lexists(path.with_name(name))]
    if editors:
        return f"it is open in an editor, which has left {editors[0]} beside it"
    return "it is open in another program" if system.is_open_elsewhere(path) else ""


def _replace(group: _Group, texts: Mapping[str, bytes]) -> Iterator[tuple[str, str]]:
    """Replaces all files whose text is new, together; yields the file and the reason if one has changed meanwhile.

    Raises:
      FileError: a file cannot be written; none is replaced.
    """
    changed = [file for file, text in texts.items() if _now(file) not in (text, group.texts.get(file))]
    if changed:
        yield _shown(group, changed[0]), f"it changed meanwhile; {RUN_AGAIN}"
        return
    with ExitStack() as stack:
        writers = [
            stack.enter_context(_rewritten(Path(_shown(group, file)), text))
            for file, text in texts.items()
            if text != _now(file)
        ]
        publish_together(writers)


@contextmanager
def _rewritten(path: Path, text: bytes) -> Generator[OutputWriter]:
    with written_file(path, text) as output:
        new, mode = Path(output.destination.path), path.stat().st_mode if path.exists() else 0
        if mode and new.stat().st_mode != mode:
            with output.writing():  # a confined process may not set it
                new.chmod(mode & 0o7777)
        yield output


def _now(file: str) -> bytes | None:
    try:
        return Path(file).read_bytes()
    except OSError:
        return None


def _shown(group: _Group, file: str) -> str:
    """Returns the path of a file as the user would write it."""
    place = next((place for place, real in group.places.items() if real == file), Path(file))
    here = Path.cwd()
    is_relative = place.is_relative_to(here) and not Path(group.models[0]).is_absolute()
    return short_path(place.relative_to(here) if is_relative else place)


def _shown_once(group: _Group, reasons: Mapping[str, str]) -> list[tuple[str, str]]:
    """Returns files and the reasons against changing them; of several new files of a folder, the first."""
    shown: dict[tuple[str, str], str] = {}
    for file, reason in reasons.items():
        if reason:
            shown.setdefault((file if file in group.texts else os.path.dirname(file), reason), file)  # noqa: PTH120
    return [(_shown(group, file), reason) for (_, reason), file in shown.items()]


def _fixed_file(group: _Group, attempt: _Attempt, file: str) -> FixedFile:
    shown, is_new = _shown(group, file), file not in group.texts
    diff = _diff(os.devnull if is_new else shown, shown, group.texts.get(file, b""), attempt.texts[file])
    if is_new:
        return FixedFile(shown, {}, diff, is_new)
    files = ((code, [edit.file for edit in _real_edits(fix)]) for code, fix in attempt.fixes)
    counts = Counter(code for code, own in files if file == next(each for each in own if each in group.texts))
    return FixedFile(shown, dict(sorted(counts.items())), diff)


def _diff(old_name: str, name: str, old: bytes, new: bytes) -> str:
    """Returns the change of a file as a unified diff; of a new one, from an empty text."""
    before, after = ([f"{line}\n" for line in text.decode(errors="replace").split("\n")] for text in (old, new))
    for lines in (before, after):
        if lines[-1] == "\n":
            lines.pop()
        else:
            lines[-1] += "\\ No newline at end of file\n"
    return "".join(difflib.unified_diff(before, after, old_name, name))


def _with_problems(results: Sequence[ModelCheckResult], problems: Sequence[tuple[str, str]]) -> list[ModelCheckResult]:
    """Returns results with a finding for each problem, at the first model."""
    findings = [NOT_FIXED.in_model(Path(file), reason) for file, reason in problems]
    first, *others = results
    return [replace(first, findings=(*first.findings, *findings)), *others]
