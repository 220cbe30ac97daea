"""Row "I/O faults": an operation of the file system fails, and no output is half of anything."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import imageio_ffmpeg

from tests.scoreboard.command import CommandServer
from tests.scoreboard.data import inputs_of
from tests.scoreboard.file_operations import REMOVAL
from tests.scoreboard.measure import Measure, Tally
from tests.scoreboard.trial import Trial, try_commands
from tests.scoreboard.writing_commands import command_server, make_inputs

MOST = (30, 3, 2)  # operations of a command that are tried, by how slow it is
RARE = ("rename", "exchange", "link", "mkdir", "truncate", "fsync")  # tried before the many writes and openings
FREE = (0, 4, 12)  # KiB that are free on a disk that is nearly full
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
ENCODERS = INPUTS["ENCODERS"]
PAYLOADS = INPUTS["PAYLOADS"]


def run(quick: bool) -> Tally:
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
        tally.left_out.append("writes to mapped memory and by io_uring: neither mjrun nor what it writes with has any")
        tally.left_out.append("mjrun view, which ends by hand: its recording is written as that of a trace")
        tally.left_out.append("an encoder that hangs: see the signals")
    return tally


def _failing_operations(trial: Trial, quick: bool) -> None:
    """Each operation fails, alone or with all that follow, where there was an older output and where there was none."""
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
                trial.judge(ended, what if with_older else f"{what}, nothing there before")


def _chosen(operations: Sequence[str], most: int) -> list[int]:
    """Numbers of operations to try, from 1 on: the rare ones first, then others, evenly spread."""
    can_fail = [number for number, operation in enumerate(operations, 1) if operation != REMOVAL]
    rare = [number for number in can_fail if operations[number - 1] in RARE]
    others = [number for number in can_fail if number not in rare]
    rare = rare[-(-most // -2) :] if most < MOST[0] else rare
    wanted = max(most - len(rare), 1)
    return sorted([*rare, *others[:: -(-len(others) // wanted)]])


def _file_sizes(trial: Trial, quick: bool) -> None:
    """No file may grow beyond a limit that one of the outputs does not keep."""
    largest = max(map(len, trial.new.first.values()))
    sizes = (largest // 2,) if trial.command.pace or quick else (1024, largest // 2, largest - 1)
    for limit in sorted({size for size in sizes if 1024 <= size < largest}):
        trial.start()
        trial.judge(trial.run(file_size=limit), f"no file beyond {limit} bytes")


def _streams(trial: Trial, quick: bool) -> None:
    """Standard streams that are closed, or that nothing more fits in: what is lost of them costs no file."""
    for name in ("2>&-", "> /dev/full")[trial.command.pace // 2 :] if trial.command.pace or quick else STREAMS:
        trial.start()
        ended = trial.run(redirected=STREAMS[name])
        loses_payload = 1 in STREAMS[name] and trial.prints
        trial.judge_made(ended, name, 7 if loses_payload else trial.code)


def _full_disk(trial: Trial, quick: bool) -> None:
    """A file system that fills up, and one that is read-only."""
    try:
        with _mounted(trial.out):
            pass
    except (OSError, subprocess.CalledProcessError):
        text = "full disks and read-only folders: no file system can be mounted here, only file-size limits were tried"
        if text not in trial.tally.left_out:
            trial.tally.left_out.append(text)
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
    """A file system of its own in a folder, and how to change it."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)], check=True, capture_output=True)

    def remount(option: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{option}", str(folder)], check=True, capture_output=True)

    try:
        yield remount
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True, capture_output=True)


def _encoders(trial: Trial) -> None:
    """An encoder that does not do its work."""
    program = trial.folder / "encoder"
    real = imageio_ffmpeg.get_ffmpeg_exe()
    for name, script in ENCODERS.items():
        answers = f'case " $* " in *" -encoders "*|*" -version "*|*" -muxers "*) exec "{real}" "$@";; esac'
        program.write_text(f"#!/bin/sh\n{answers}\n{script}\n")
        program.chmod(0o755)
        trial.start()
        ended = trial.run(environment={"IMAGEIO_FFMPEG_EXE": str(program)})
        trial.judge(ended, f"an encoder that {name}", codes=(6,))


def _payloads(folder: Path, server: CommandServer, tally: Tally) -> None:
    """What cannot be written to standard output is an output that cannot be written."""
    for line in PAYLOADS:
        for name in (">&-", "> /dev/full", "<&- >&- 2>&-"):
            out = folder / "payload"
            shutil.rmtree(out, ignore_errors=True)
            arguments = line.format(out=out).split()
            ended = server.run(*arguments, folder=folder / "inputs", redirected=STREAMS[name])
            silent = 2 in STREAMS[name]
            faults = [fault for fault in ended.faults if not silent or "without a word" not in fault]
            tally.expect(ended.code == 7 and not faults, f"{line} {name}: {ended} {faults}")


MEASURE = Measure(
    "I/O faults",
    "the N-th write, open, fsync, rename, link, mkdir or truncate fails, once or from then on; disk full; file-size "
    "limit; read-only folder; closed and full streams; an encoder that dies: every output old or new, nothing left "
    "over, the right exit code, the file named",
    1000,
    run,
)
