"""Row "kill -9": whenever a command is killed, its outputs are the old or the new ones, and the next run tidies up."""

import random
import signal

from tests.scoreboard.command import Ended
from tests.scoreboard.measure import Measure, Tally
from tests.scoreboard.trial import Trial, try_commands

MOMENTS = (12, 4, 2)  # random ones of a command, by how slow it is
SEED = 17


def run(quick: bool) -> Tally:
    def disturb(trial: Trial) -> None:
        command = trial.command
        _at_operations(trial, quick)
        _at_moments(trial, random.Random(f"{SEED} {command.name}"), 1 if quick else MOMENTS[command.pace])

    tally = try_commands(disturb, quick)
    if not quick:
        tally.left_out.append("a power cut, which loses what the system had not written yet: files are synced first")
        tally.left_out.append("mjrun view, which ends by hand: its recording is written as that of a trace")
    return tally


def _at_operations(trial: Trial, quick: bool) -> None:
    trial.start()
    operations = trial.operations()
    numbers = set(range(1, len(operations) + 1))
    if quick and operations:
        moves = [n for n, operation in enumerate(operations, 1) if operation in ("rename", "exchange")]
        numbers = {1, len(operations), *moves[-2:]}
    for number in sorted(numbers):
        trial.start()
        ended = trial.watch(number, "kill")
        operation = ended.operations[number - 1][0] if len(ended.operations) >= number else "none"
        _judge(trial, ended, f"killed before operation {number} ({operation})")


def _at_moments(trial: Trial, moments: random.Random, count: int) -> None:
    for _ in range(count):
        moment = moments.uniform(0, trial.seconds)
        trial.start()
        _judge(trial, trial.run(kill_after=moment), f"killed after {moment:.3f} s of {trial.seconds:.3f} s")


def _judge(trial: Trial, ended: Ended, case: str) -> None:
    problems = trial.torn()
    if ended.code not in (trial.code, -signal.SIGKILL):
        problems.append(f"exit code {ended.code}")
    trial.judge_next(case, problems)


MEASURE = Measure(
    "kill -9",
    "SIGKILL at every file operation and at random moments: every output is the old or the new one, never a mixture, "
    "never nothing; the next run removes what is left over, and comes to the same results bit for bit",
    500,
    run,
)
