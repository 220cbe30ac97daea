"""The models of the DeepMind Control Suite as model sources, written `dm:DOMAIN` or `dm:DOMAIN/TASK`."""

import ast
import importlib.util
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import ClassVar

from mjrun.dataclass import dataclass
from mjrun.errors import ModelNotFoundError
from mjrun.model.sources.file import CollectionFileSource
from mjrun.platform.installation import install_command

PACKAGE, SUITE = "dm_control", "suite"
# Domains with tasks whose Python code changes the XML before compilation: all tasks, or those listed.
CHANGED: Mapping[str, tuple[str, ...]] = {
    "cartpole": ("two_poles", "three_poles"),
    "dog": (),
    "lqr": (),
    "manipulator": (),
    "quadruped": (),
    "stacker": (),
    "swimmer": (),
}


@dataclass(frozen=True)
class ControlSuiteSource(CollectionFileSource):
    """A model of the DeepMind Control Suite, read from the XML in the installed package, which is not imported.

    A task whose model dm_control changes in Python is refused; `dm:DOMAIN` is the XML itself.
    """

    PREFIX: ClassVar[str] = "dm"
    KIND: ClassVar[str] = "domain"
    NO_TASK: ClassVar[str] = f"tasks of {PACKAGE} cannot be played: up to version 1.0.50 it does not run on MuJoCo 4"

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        lines: dict[str, str] = {}
        for domain, tasks in _installed_domains(cls.PREFIX).items():
            changed = _changed(domain, tasks)
            plain = [task for task in tasks if task not in changed]
            parts = [f"{domain}.xml", *([f"for {', '.join(plain)}"] if plain else [])]
            lines[domain] = " ".join(parts) + (f"; Python changes it for {', '.join(changed)}" if changed else "")
        return lines

    @property
    def main_file(self) -> Path:
        domain, slash, task = self.name.partition("/")
        domains = _installed_domains(self.label)
        if domain not in domains:
            self.check_name(domain)
        if slash and task not in domains[domain]:
            place = f"tasks of {domain}"
            raise ModelNotFoundError(self.text, f"{domain} has no such task", list(domains[domain]), place, task)
        if task in _changed(domain, domains[domain]):
            reason = f"its model is made by Python code of {PACKAGE}, which mjrun does not run"
            raise ModelNotFoundError(self.text, f"{reason}\ndm:{domain} is the XML before the change")
        return _folder() / f"{domain}.xml"


def _folder() -> Path:
    """Returns the folder of the suite, which may not exist."""
    package = importlib.util.find_spec(PACKAGE)
    folders = package.submodule_search_locations if package else None
    return Path(next(iter(folders or [""])), SUITE)


def _installed_domains(text: str) -> Mapping[str, tuple[str, ...]]:
    """Returns the tasks of each domain; raises ModelNotFoundError about `text` if dm_control is not installed."""
    if domains := _domains():
        return domains
    advice = f"{install_command(PACKAGE)}; mjrun reads its model files and does not import it"
    raise ModelNotFoundError(text, f"{PACKAGE} is not installed\n{advice}")


@cache
def _domains() -> Mapping[str, tuple[str, ...]]:
    """Returns the tasks of each domain, as their Python code registers them; empty if dm_control is not installed."""
    code = sorted(path.with_suffix(".py") for path in _folder().glob("*.xml"))
    return {path.stem: _tasks(path) for path in code if path.is_file()}


def _tasks(path: Path) -> tuple[str, ...]:
    """Returns the functions of a module that are decorated with `@SUITE.add(…)`."""
    functions = [node for node in ast.parse(path.read_text("utf-8")).body if isinstance(node, ast.FunctionDef)]
    return tuple(node.name for node in functions if any("SUITE.add" in ast.unparse(d) for d in node.decorator_list))


def _changed(domain: str, tasks: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the tasks of a domain whose model differs from its XML."""
    return tuple(task for task in tasks if domain in CHANGED and task in (CHANGED[domain] or tasks))
