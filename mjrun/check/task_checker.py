"""The check of a task: its document, its model and policy, and episodes of random actions."""

from collections.abc import Callable
from dataclasses import replace
from pkgutil import resolve_name
from typing import TextIO, cast

from mjrun.check import rule_table
from mjrun.check.rule import Finding, Place
from mjrun.check.rules import tasks
from mjrun.check.task_episodes import COUNT, TaskPlaces, place_of, watch
from mjrun.check.worker import ARENAS, Checker
from mjrun.check.worker_pool import MIB, WorkerTask
from mjrun.child_process import limit_this_process
from mjrun.errors import DocumentError, FileError, MjrunError, ModelError, UsageError, clean, option
from mjrun.formats.input_file import require_file
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.model.source import Source
from mjrun.model.xml_source import read_xml
from mjrun.options.policy import RANDOM
from mjrun.policy.agreement import check_agreement
from mjrun.policy.load import load_policy
from mjrun.policy.policy import Policy
from mjrun.suffixes import YAML
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds


class TaskChecker(Checker):
    """The check of one task."""

    def __init__(self, task: WorkerTask, channel: TextIO) -> None:
        super().__init__(task, channel)
        self._written: list[Finding] = []  # a finding of both random actions and a policy is written once

    def check(self) -> None:
        self.write(stage="reading it")
        task = self._read()
        if task is None:
            return
        self.write(stage="loading its model")
        worlds = self._worlds(task)
        if worlds is None:
            return
        self.write(loaded=True)
        limit_this_process(memory=self.task.memory * MIB + ARENAS * COUNT * worlds.model(0).narena)
        places = TaskPlaces(task, self.path)
        self._write_selected(list(tasks.beyond_ranges(worlds, places)))

        self.write(stage="asking its policy")
        policy = self._policy(task)
        if self.task.steps and tasks.CODES.intersection(self.task.codes):
            self.write(stage="taking random actions")
            self._watch(worlds, load_policy(RANDOM), places)
        if policy is not None:
            self.write(stage="playing its policy")
            self._watch(worlds, policy, places)

    def _read(self) -> Task | None:
        """Returns the task; None if it cannot be read or has mistakes, which are written."""
        read = cast("Callable[[str], Task]", resolve_name(self.task.reader))
        try:
            require_file(self.path, "task document", YAML)
        except FileError as error:
            self._write_mistake(error)
            return None
        try:
            return read(self.task.path)
        except (UsageError, FileError) as error:
            self._write_mistakes(error)
        return None

    def _worlds(self, task: Task) -> TaskWorlds | None:
        """Returns worlds of the task; None if its model is missing or does not fit, which is written."""
        try:
            with collected_warnings():
                return TaskWorlds(task, COUNT, threads=1)
        except ModelError as error:
            self.write_findings(self._of_model(error, task.model))
        except (UsageError, FileError) as error:
            self._write_mistakes(error)
        return None

    def _of_model(self, error: ModelError, source: Source) -> list[Finding]:
        """Returns findings that explain why the model of a task does not load."""
        if source.main_file is not None:
            return rule_table.explain(error, read_xml(source.main_file))
        message, _, remedy = str(error).partition("\n")
        return [tasks.MISTAKE.in_model(self.path, message, remedy)]

    def _write_mistakes(self, error: MjrunError) -> None:
        """Writes the mistakes in the document; the model is not at fault."""
        self.write(loaded=True)
        if not isinstance(error, DocumentError):
            self._write_mistake(error)
            return
        for problem in error.problems:
            place = f"{problem.path}: {problem.message}" if problem.path else problem.message
            self.write_findings([tasks.MISTAKE.finding(place, "", place_of(problem, self.path))])

    def _write_mistake(self, error: MjrunError) -> None:
        message, _, remedy = error.spelled(option).partition("\n")
        message = message.removeprefix(f"{clean(str(self.path))}: ")
        self.write_findings([tasks.MISTAKE.in_model(self.path, message, remedy)])

    def _policy(self, task: Task) -> Policy | None:
        """Returns the requested policy; None without a request, or if it does not fit, which is reported."""
        if not self.task.policy:
            return None
        try:
            policy = load_policy(self.task.policy, trust=self.task.trust, normalize=self.task.normalize)
            check_agreement(task, policy)
        except MjrunError as error:
            self._write_misfit(error)
            return None
        return policy

    def _watch(self, worlds: TaskWorlds, policy: Policy, places: TaskPlaces) -> None:
        try:
            with collected_warnings(), without_timers():
                episodes = watch(worlds, policy)
        except (MjrunError, ValueError) as error:  # a ValueError: actions that are not finite
            self._write_misfit(error)
            return
        self._write_selected(list(tasks.episode_findings(episodes, places)))

    def _write_misfit(self, error: Exception) -> None:
        text = error.spelled(option) if isinstance(error, MjrunError) else str(error)
        message, _, remedy = text.partition("\n")
        finding = tasks.MISFIT.finding(message, remedy, Place(self.path))
        self.write_findings([replace(finding, object="")])

    def _write_selected(self, findings: list[Finding]) -> None:
        by_code: dict[str, list[Finding]] = {}
        for finding in findings:
            by_code.setdefault(finding.code, []).append(finding)
        for code, group in by_code.items():
            if code in self.task.codes:
                news = [finding for finding in rule_table.capped(group) if finding not in self._written]
                self._written += news
                self.write_findings(news)
