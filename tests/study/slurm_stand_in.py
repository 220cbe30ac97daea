"""A stand-in for Slurm: `sbatch` runs the tasks of the script that it receives, as many at once as its array states.

`srun`, `scancel` and `sacct` do what submitit needs. All state is in files of one folder: a log of `sbatch` and
`scancel`, the state of each job, and optionally `limit`, the largest number of jobs that `sbatch` accepts in the queue.
"""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

COMMANDS = ("sbatch", "srun", "scancel", "sacct")
ENDED = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL")


def install(folder: Path) -> None:
    """Writes the commands to a folder, which is to be the first in PATH."""
    folder.mkdir()
    for name in COMMANDS:
        path = folder / name
        path.write_text(f'#!/bin/sh\nexec {sys.executable} -S {__file__} "$0" "$@"\n')
        path.chmod(0o755)
    (folder / "log").touch()


def states(folder: Path) -> dict[str, str]:
    """Returns the state of each job."""
    return {path.stem: path.read_text() for path in sorted(folder.glob("*.state"))}


def _set(folder: Path, job: str, state: str) -> None:
    whole = folder / f"{job}.{os.getpid()}"
    whole.write_text(state)
    whole.replace(folder / f"{job}.state")


def _log(folder: Path, text: str) -> None:
    with (folder / "log").open("a") as stream:
        stream.write(f"{text}\n")


def sbatch(folder: Path, script: str) -> int:
    flags = dict(re.findall(r"^#SBATCH --([\w-]+)=(.*)$", Path(script).read_text(), re.MULTILINE))
    number = str(1000 + (folder / "log").read_text().count("sbatch"))
    array = re.fullmatch(r"0-(\d+)%(\d+)", flags.get("array", ""))
    jobs = [f"{number}_{index}" for index in range(int(array[1]) + 1)] if array else [number]
    _log(folder, f"sbatch {flags.get('array', '')}")
    queue = sum(state not in ENDED for state in states(folder).values())
    with suppress(FileNotFoundError):
        if queue + len(jobs) > int((folder / "limit").read_text()):
            sys.stderr.write("sbatch: error: Batch job submission failed: Job violates accounting/QOS policy\n")
            return 1
    for job in jobs:
        _set(folder, job, "PENDING")
    copy = folder / f"{number}.sh"  # like that of Slurm, as submitit renames the script
    copy.write_text(Path(script).read_text())
    command = [sys.executable, "-S", __file__, str(folder / "controller"), str(copy), array[2] if array else "1", *jobs]
    subprocess.Popen(
        [*command, flags["output"]],
        start_new_session=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    sys.stdout.write(f"Submitted batch job {number}\n")
    return 0


def controller(folder: Path, script: str, most: str, *arguments: str) -> int:
    """Runs jobs, `most` at once."""
    waiting, output = [*arguments[:-1]], arguments[-1]
    running = dict[str, subprocess.Popen[bytes]]()
    while waiting or running:
        for job, process in [*running.items()]:
            if process.poll() is not None:
                del running[job]
                if states(folder)[job] == "RUNNING":
                    _set(folder, job, "FAILED" if process.returncode else "COMPLETED")
        waiting = [job for job in waiting if states(folder)[job] == "PENDING"]
        while waiting and len(running) < int(most):
            job, waiting = waiting[0], waiting[1:]
            number, _, index = job.partition("_")
            own = {"SLURM_JOB_ID": number, "SLURM_NTASKS": "1", "SLURM_JOB_NUM_NODES": "1", "SLURM_PROCID": "0"}
            own |= {"SLURM_ARRAY_JOB_ID": number, "SLURM_ARRAY_TASK_ID": index} if index else {}
            _set(folder, job, "RUNNING")
            with Path(_path(output, own)).open("ab") as stream:
                running[job] = subprocess.Popen(
                    ["bash", script], env=os.environ | own, stdout=stream, stderr=stream, start_new_session=True
                )
            (folder / f"{job}.process").write_text(str(running[job].pid))
        time.sleep(0.02)
    return 0


def srun(folder: Path, *arguments: str) -> int:
    words = [*arguments]
    options = {words.pop(0): words.pop(0) for _ in range(2) if words[0] != "--unbuffered" or words.pop(0)}
    with (
        Path(_path(options["--output"], os.environ)).open("ab") as output,
        Path(_path(options["--error"], os.environ)).open("ab") as error,
    ):
        return subprocess.run(words, stdout=output, stderr=error, check=False).returncode


def scancel(folder: Path, *jobs: str) -> int:
    _log(folder, f"scancel {' '.join(jobs)}")
    for job in jobs:
        state = states(folder)[job]
        if state not in ENDED:
            _set(folder, job, "CANCELLED")
        if state == "RUNNING":
            with suppress(OSError):
                os.killpg(int((folder / f"{job}.process").read_text()), signal.SIGKILL)
    return 0


def sacct(folder: Path, *arguments: str) -> int:
    sys.stdout.write("JobID|State|NodeList\n")
    sys.stdout.writelines(f"{job}|{state}|here\n" for job, state in states(folder).items())
    return 0


def _path(pattern: str, environment: "os._Environ[str] | dict[str, str]") -> str:
    """Replaces the marks in the name of a log."""
    pattern = pattern.strip("'")
    for mark, name in (("%j", "SLURM_JOB_ID"), ("%A", "SLURM_ARRAY_JOB_ID"), ("%a", "SLURM_ARRAY_TASK_ID")):
        pattern = pattern.replace(mark, environment.get(name, mark))
    return pattern.replace("%t", "0")


if __name__ == "__main__":
    called = Path(sys.argv[1])
    sys.exit(globals()[called.name](called.parent, *sys.argv[2:]))
