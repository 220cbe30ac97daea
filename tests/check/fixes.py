"""Fixes in this process: models are checked without simulation, and compared as the processes do."""

from collections.abc import Sequence
from pathlib import Path

from mjrun.check.check import _of_original
from mjrun.check.context import CheckContext
from mjrun.check.finding import FixedModelCopy, FixResult, ModelCheckResult
from mjrun.check.fixing import ModelFixer, changed_fields
from mjrun.check.rule_runner import RULES, apply, explain, ignored_xml
from mjrun.check.worker_pool import CheckRequest
from mjrun.errors import ModelError
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.xml_source import read_xml


def lint(model: str, copy: FixedModelCopy | None = None, *, unsafe: bool = False) -> FixResult:
    """Checks a model, or a copy of it."""
    path = copy.path if copy else Path(model)
    source = read_xml(path)
    changes = None
    try:
        with collected_warnings():
            context = CheckContext.load(path, source)
    except ModelError as error:
        found, loads = explain(error, source), False
    else:
        context.unsafe, loads, context.home = unsafe, True, Path(model).absolute().parent
        found = [*ignored_xml(source), *(finding for code in RULES for finding in apply(code, context))]
        changes = changed_fields(copy.original, context.model) if copy else None
    task = CheckRequest(str(path), (), 0, 0, 0, model=model, root=str(copy.root) if copy else "")
    return FixResult(ModelCheckResult(model, loads, tuple(_of_original(finding, task) for finding in found)), changes)


def fixing(*models: str, given: Sequence[str] = (), unsafe: bool = False, dry_run: bool = False) -> ModelFixer:
    """The fixes of models after they were made; `results` are those after that."""
    made = ModelFixer(
        given or models, models, lambda copies: [lint(copy.model, copy, unsafe=unsafe) for copy in copies]
    )
    before = [lint(model, unsafe=unsafe).result for model in models]
    made.results = made.fixed(before, dry_run=dry_run)  # type: ignore[attr-defined]
    return made


def fix(*models: str, unsafe: bool = False) -> dict[str, dict[str, int]]:
    """Fixes models, and returns the number of fixes of each rule, by file."""
    return {fixed.file: dict(fixed.fixes) for fixed in fixing(*models, unsafe=unsafe).files}


def fixed(text: str, *, unsafe: bool = False) -> str:
    """The text of a model after its fixes, which must be final."""
    path = Path("model.xml")
    path.write_text(text)
    fix("model.xml", unsafe=unsafe)
    assert fix("model.xml", unsafe=unsafe) == {}
    return path.read_text()
