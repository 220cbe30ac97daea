"""Commands that write while an operation of the file system fails, or while they are killed."""

import os
import random
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import imageio_ffmpeg

from tests.scoreboard.command import CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.file_operations import REMOVAL
from tests.scoreboard.measure import Tally, measured
from tests.scoreboard.trial import Trial, try_commands
from tests.scoreboard.writing_commands import command_server, make_inputs

MOST = (30, 3, 2)  # number of operations of a command to try, by its pace
RARE = ("rename", "exchange", "link", "mkdir", "truncate", "fsync")  # tried before the many writes and openings
FREE = (0, 4, 12)  # KiB free on a nearly full disk
STREAMS: Mapping[str, Mapping[int, str]] = {
    ">&-": {1: ""},
    "> /dev/full": {1: "/dev/full"},
    "2>&-": {2: ""},
    "2> /dev/full": {2: "/dev/full"},
    "<&-": {0: ""},
    "<&- >&- 2>&-": {0: "", 1: "", 2: ""},
}
ENCODED = ("mp4", "gif", "webm", "apng", "mkv")
INPUTS = inputs_of(__name__)
MOMENTS = (12, 4, 2)  # random moments at which a command is killed, by its pace
SEED = 17
VIEW = "mjrun view, which ends by hand: its recording is written like that of a trace"


@measured(
    "I/O faults",
    "the N-th write, open, fsync, rename, link, mkdir or truncate fails, once or from then on; disk full; file-size "
    "limit; read-only folder; closed and full streams; an encoder that dies: every output old or new, nothing left "
    "over, the right exit code, the file named",
    1000,
)
def io_faults(quick: bool) -> Tally:
    def disturb(trial: Trial) -> None:
        _failing_operations(trial, quick)
        _file_sizes(trial, quick)
        _streams(trial, quick)
        _full_disk(trial, quick)
        if trial.command.name in ENCODED:
            _encoders(trial)

    tally = try_commands(disturb, quick)
    if not quick:
        with tempfile.TemporaryDirectory() as name, command_server(quick) as server:
            folder = Path(os.path.realpath(name))
            make_inputs(folder / "inputs", server)
            _payloads(folder, server, tally)
        tally.leave_out("writes to mapped memory and by io_uring: neither mjrun nor its libraries use them")
        tally.leave_out(VIEW)
        tally.leave_out("an encoder that hangs: see the signals")
    return tally


def _failing_operations(trial: Trial, quick: bool) -> None:
    """Makes each operation fail, alone or with all that follow, with and without an older output."""
    for with_older in (True, False):
        trial.start(with_older=with_older)
        operations = trial.operations()
        most = 2 if quick else MOST[trial.command.pace]
        for index, number in enumerate(_chosen(operations, most)):
            for kind in ("once", "from then on"):
                if most < MOST[0] and (index % 2 == 0) == (with_older == (kind == "once")):
                    continue  # of slow ones, half of the combinations
                trial.start(with_older=with_older)
                ended = trial.watch(number, kind)
                what = f"operation {number} ({operations[number - 1]}) fails {kind}"
                trial.judge(ended, what if with_older else f"{what}, without older outputs")


def _chosen(operations: Sequence[str], most: int) -> list[int]:
    """Returns numbers of operations to try, from 1 on: the rare ones, and others, evenly spread."""
    can_fail = [number for number, operation in enumerate(operations, 1) if operation != REMOVAL]
    rare = [number for number in can_fail if operations[number - 1] in RARE]
    others = [number for number in can_fail if number not in rare]
    rare = rare[-(-most // -2) :] if most < MOST[0] else rare
    wanted = max(most - len(rare), 1)
    return sorted([*rare, *others[:: -(-len(others) // wanted)]])


def _file_sizes(trial: Trial, quick: bool) -> None:
    """Limits the size of files to less than the largest output."""
    largest = max(map(len, trial.new.first.values()))
    sizes = (largest // 2,) if trial.command.pace or quick else (1024, largest // 2, largest - 1)
    for limit in sorted({size for size in sizes if 1024 <= size < largest}):
        trial.start()
        trial.judge(trial.run(file_size=limit), f"no file beyond {limit} bytes")


def _streams(trial: Trial, quick: bool) -> None:
    """Closes or fills standard streams: no file may be lost with them."""
    for name in ("2>&-", "> /dev/full")[trial.command.pace // 2 :] if trial.command.pace or quick else STREAMS:
        trial.start()
        ended = trial.run(redirected=STREAMS[name])
        loses_payload = 1 in STREAMS[name] and trial.prints
        trial.judge_made(ended, name, 7 if loses_payload else trial.code)


def _full_disk(trial: Trial, quick: bool) -> None:
    """Runs in a file system that fills up, and in one that is read-only."""
    try:
        with _mounted(trial.out):
            pass
    except (OSError, subprocess.CalledProcessError):
        text = "full disks and read-only folders: no file system can be mounted here, only file-size limits were tried"
        trial.tally.leave_out(text)
        return
    for free in FREE[-1:] if quick or trial.command.pace else FREE:
        with _mounted(trial.out) as remount:
            trial.start()
            used = os.statvfs(trial.out)
            remount(f"size={(used.f_blocks - used.f_bfree) * used.f_frsize + 1024 * free}")
            trial.judge(trial.run(), f"a disk with {free} KiB free")
    with _mounted(trial.out) as remount:
        trial.start()
        remount("ro")
        trial.judge(trial.run(), "a read-only folder")


@contextmanager
def _mounted(folder: Path) -> Generator:
    """Mounts a file system in a folder, and yields a function that changes it."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)], check=True, capture_output=True)

    def remount(option: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{option}", str(folder)], check=True, capture_output=True)

    try:
        yield remount
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True, capture_output=True)


def _encoders(trial: Trial) -> None:
    """Replaces the encoder by programs that fail."""
    program = trial.folder / "encoder"
    real = imageio_ffmpeg.get_ffmpeg_exe()
    for name, script in INPUTS["ENCODERS"].items():
        answers = f'case " $* " in *" -encoders "*|*" -version "*|*" -muxers "*) exec "{real}" "$@";; esac'
        program.write_text(f"#!/bin/sh\n{answers}\n{script}\n")
        program.chmod(0o755)
        trial.start()
        ended = trial.run(environment={"IMAGEIO_FFMPEG_EXE": str(program)})
        trial.judge(ended, f"an encoder that {name}", codes=(6,))


def _payloads(folder: Path, server: CommandServer, tally: Tally) -> None:
    """Tries outputs on a standard output that cannot be written."""
    for line in INPUTS["PAYLOADS"]:
        for name in (">&-", "> /dev/full", "<&- >&- 2>&-"):
            out = folder / "payload"
            shutil.rmtree(out, ignore_errors=True)
            arguments = line.format(out=out).split()
            ended = server.run(*arguments, folder=folder / "inputs", redirected=STREAMS[name])
            silent = 2 in STREAMS[name]
            faults = [fault for fault in ended.faults if not silent or "without a word" not in fault]
            tally.expect(ended.code == 7 and not faults, f"{line} {name}: {ended} {faults}")


@measured(
    "kill -9",
    "SIGKILL at every file operation and at random moments: every output is the old or the new one, never a mixture, "
    "never missing; the next run removes leftovers, and gives identical results bit for bit",
    500,
)
def kills(quick: bool) -> Tally:
    def disturb(trial: Trial) -> None:
        command = trial.command
        _at_operations(trial, quick)
        _at_moments(trial, random.Random(f"{SEED} {command.name}"), 1 if quick else MOMENTS[command.pace])

    tally = try_commands(disturb, quick)
    if not quick:
        tally.leave_out("a power cut, which loses data that the system has not written yet: files are synced first")
        tally.leave_out(VIEW)
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
        _judge_kill(trial, ended, f"killed before operation {number} ({operation})")


def _at_moments(trial: Trial, moments: random.Random, count: int) -> None:
    for _ in range(count):
        moment = moments.uniform(0, trial.seconds)
        trial.start()
        _judge_kill(trial, trial.run(kill_after=moment), f"killed after {moment:.3f} s of {trial.seconds:.3f} s")


def _judge_kill(trial: Trial, ended: Ended, case: str) -> None:
    problems = trial.torn()
    if ended.code not in (trial.code, -signal.SIGKILL):
        problems.append(f"exit code {ended.code}")
    trial.judge_next(case, problems)
