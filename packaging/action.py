"""The step of action.yml that runs mjrun: writes its report to the summary, and what later steps need to the outputs.

The command line comes from the variable COMMAND and never reaches a shell. SARIF=true adds a run of `mjrun check` that
prints SARIF.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

MEANINGS = {
    0: "done",
    1: "the answer is no",
    2: "wrong usage",
    3: "the model does not load",
    4: "unstable simulation",
    5: "no rendering",
    6: "encoder",
    7: "input or output",
    8: "partly done",
    70: "a bug in mjrun",
}
LIMIT = 60_000  # characters of the report; a comment holds 65,536
ANNOTATION = re.compile(r"^::\w+ file=(.*?)(?:,line=(\d+))?,title=(.*?)::(.*)$", re.MULTILINE)


def main() -> None:
    """Runs the command and writes the report and the outputs of the step."""
    words = shlex.split(os.environ["COMMAND"])
    folder = Path(os.environ.get("RUNNER_TEMP", "."))
    before = files()
    done = subprocess.run(["mjrun", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    text = done.stdout.decode("utf-8", "replace")
    sys.stdout.write(text)

    report = folder / "mjrun-report.md"
    report.write_text(markdown(words, done.returncode, text), "utf-8")
    append("GITHUB_STEP_SUMMARY", report.read_text("utf-8"))
    append("GITHUB_OUTPUT", f"exit-code={done.returncode}\nreport={report}\n")
    if written := sorted(str(path) for path, time in files().items() if before.get(path) != time):
        append("GITHUB_OUTPUT", "\n".join(["files<<END_OF_FILES", *written, "END_OF_FILES", ""]))
    if os.environ.get("SARIF") == "true" and words[:1] == ["check"]:
        findings = folder / "mjrun.sarif"
        kept = [word for word in words if word not in ("--github", "--json")]
        with findings.open("wb") as file:
            subprocess.run(["mjrun", *kept, "--sarif"], stdout=file, check=False)
        append("GITHUB_OUTPUT", f"sarif={findings}\n")


def files() -> dict[Path, int]:
    """Returns the files below the working directory, each with the time of its last change."""
    paths = (path for path in Path.cwd().rglob("*") if ".git" not in path.parts)
    return {path: path.stat().st_mtime_ns for path in paths if path.is_file()}


def markdown(words: list[str], code: int, text: str) -> str:
    """Returns the report: the command, its exit code in words, and what it printed."""
    text = ANNOTATION.sub(readable, text)
    fence = "`" * (1 + max(map(len, re.findall("`+", text)), default=3))
    body = text if len(text) <= LIMIT else f"{text[:LIMIT]}\n… {len(text) - LIMIT} more characters are in the log"
    meaning = MEANINGS.get(code, "ended by a signal" if code < 0 or code > 128 else "failed")
    return f"### `mjrun {shlex.join(words)}`\n\nExit code {code}: {meaning}\n\n{fence}text\n{body.rstrip()}\n{fence}\n"


def readable(annotation: "re.Match[str]") -> str:
    """Returns an annotation of `--github` as a person reads it."""
    file, line, title, message = annotation.groups("")
    text = f"{file}{line and ':'}{line}: {title}: {message}"
    for code, character in (("%0A", "\n    "), ("%0D", ""), ("%3A", ":"), ("%2C", ","), ("%25", "%")):
        text = text.replace(code, character)
    return text


def append(variable: str, text: str) -> None:
    """Appends a text to the file that a variable names."""
    with Path(os.environ[variable]).open("a", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    main()
