"""What is around a release: files by their own schemas and tools, and the shell and Python in them, executed."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from tests import prepared_interpreters
from tests.documentation import ROOT

sys.path.append(str(ROOT))

from scripts import release_check

TOOLS = Path(sys.executable).parent
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
SCHEMAS = [
    ("vendor.github-actions", ROOT / "action.yml"),
    ("vendor.citation-file-format", ROOT / "CITATION.cff"),
    ("vendor.github-issue-config", ROOT / ".github/ISSUE_TEMPLATE/config.yml"),
    *(("vendor.github-issue-forms", ROOT / f".github/ISSUE_TEMPLATE/{name}.yml") for name in ("bug", "feature")),
    *(("vendor.github-workflows", path) for path in WORKFLOWS),
    *(("custom.github-workflows-require-timeout", path) for path in WORKFLOWS),
]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text("utf-8"))
STEPS = {step.get("name", step.get("uses")): step for step in ACTION["runs"]["steps"]}


@pytest.mark.parametrize("schema", sorted({name for name, _ in SCHEMAS}))
def test_files_fit_their_schemas(schema: str) -> None:
    import check_jsonschema

    files = [str(path) for name, path in SCHEMAS if name == schema]
    done = CliRunner().invoke(check_jsonschema.main, ["--builtin-schema", schema, *files])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    "command",
    [["pre-commit", "validate-manifest", ".pre-commit-hooks.yaml"], ["hadolint", "packaging/Containerfile"]],
    ids=["pre-commit", "hadolint"],
)
def test_files_pass_their_tools(command: list[str]) -> None:
    name, *arguments = command
    done = subprocess.run([TOOLS / name, *arguments], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("path", [ROOT / "action.yml", *WORKFLOWS], ids=lambda path: path.name)
def test_actions_of_others_are_pinned_and_inputs_reach_shells_as_variables(path: Path) -> None:
    text = path.read_text("utf-8")
    assert all(re.search(r"@[0-9a-f]{40} # v[\d.]+$", line) for line in text.splitlines() if "uses:" in line)
    scripts = [step["run"] for step in all_steps(yaml.safe_load(text)) if "run" in step]
    assert scripts
    assert [script for script in scripts if "${{" in script] == []


def all_steps(document: dict[str, object]) -> list[dict[str, str]]:
    jobs = document.get("jobs", {"": document.get("runs")})
    assert isinstance(jobs, dict)
    return [step for job in jobs.values() for step in job["steps"]]


@pytest.fixture
def runner(tmp_path: Path) -> dict[str, str]:
    """The variables of a runner, with `mjrun` and `gh` on the path; `gh` writes down its arguments."""
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "mjrun").write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec {prepared_interpreters.program()} "$@"\n')
    (programs / "gh").write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > "{tmp_path}/gh"\n')
    for program in programs.iterdir():
        program.chmod(0o755)
    (tmp_path / "work").mkdir()
    files = {name: str(tmp_path / name) for name in ("GITHUB_STEP_SUMMARY", "GITHUB_OUTPUT")}
    paths = {"PATH": f"{programs}:{os.environ['PATH']}", "RUNNER_TEMP": str(tmp_path)}
    return {**os.environ, **files, **paths, "GITHUB_REPOSITORY": "owner/name", "GITHUB_SHA": "1", "GITHUB_REF": "r"}


def run_action(runner: dict[str, str], command: str, **variables: str) -> dict[str, str]:
    """Executes the step of the action that runs mjrun, and returns its outputs."""
    folder = Path(runner["RUNNER_TEMP"]) / "work"
    environment = {**runner, "COMMAND": command, **variables}
    subprocess.run([sys.executable, ROOT / "packaging/action.py"], cwd=folder, env=environment, check=True, timeout=120)
    text = Path(runner["GITHUB_OUTPUT"]).read_text("utf-8")
    several = dict(re.findall(r"^(\S+)<<END_OF_FILES\n(.*?)\nEND_OF_FILES$", text, re.DOTALL | re.MULTILINE))
    return {**dict(re.findall(r"^([\w-]+)=(.*)$", text, re.MULTILINE)), **several}


def test_the_action_reports_the_command_its_output_and_its_files(runner: dict[str, str]) -> None:
    outputs = run_action(runner, "trace scene:pendulum --key level --duration 0.01 -o 'a table.csv'")

    assert outputs["exit-code"] == "0"
    assert outputs["files"] == str(Path(runner["RUNNER_TEMP"]) / "work/a table.csv")
    summary = Path(runner["GITHUB_STEP_SUMMARY"]).read_text("utf-8")
    assert "mjrun trace scene:pendulum" in summary
    assert "rows" in summary
    assert summary == Path(outputs["report"]).read_text("utf-8")


def test_a_command_of_the_action_reaches_no_shell(runner: dict[str, str]) -> None:
    outputs = run_action(runner, "info scene:pendulum; touch owned $(touch owned)")

    assert outputs["exit-code"] != "0"
    assert "files" not in outputs


def test_the_action_uploads_findings_and_comments_on_differences(runner: dict[str, str]) -> None:
    (Path(runner["RUNNER_TEMP"]) / "work/broken.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    outputs = run_action(runner, "check broken.xml --github", SARIF="true")
    assert '"version": "2.1.0"' in Path(outputs["sarif"]).read_text("utf-8")

    uploaded = run_step(runner, "Upload findings", FINDINGS=outputs["sarif"])
    assert uploaded[:2] == ["api", "repos/owner/name/code-scanning/sarifs"]

    comment = run_step(runner, "Comment on the pull request", NUMBER="7", REPORT=outputs["report"], FILES="https://a/b")
    assert comment[:3] == ["pr", "comment", "7"]
    assert "(https://a/b)" in Path(outputs["report"]).read_text("utf-8")


GITHUB = """#!{python}
import base64, json, os, subprocess, sys
path, method = sys.argv[2].removeprefix("repos/owner/name/git/"), sys.argv[4]
fields = json.load(sys.stdin) if "--input" in sys.argv else {{}}

def git(*arguments, content=b""):
    command = ["git", "-C", "{repository}", *arguments]
    return subprocess.run(command, input=content, stdout=subprocess.PIPE, check=True).stdout.decode().strip()

if path == "blobs":
    answer = {{"sha": git("hash-object", "-w", "--stdin", content=base64.b64decode(fields["content"]))}}
elif path == "trees":
    for each in fields["tree"]:
        git("update-index", "--add", "--cacheinfo", each["mode"] + "," + each["sha"] + "," + each["path"])
    answer = {{"sha": git("write-tree")}}
elif path == "commits":
    parents = [word for parent in fields["parents"] for word in ("-p", parent)]
    answer = {{"sha": git("commit-tree", fields["tree"], *parents, "-m", fields["message"])}}
elif path.startswith("matching-refs/"):
    words = git("for-each-ref", "--format=%(refname) %(objectname)", "refs/" + path.partition("/")[2]).split()
    answer = [{{"ref": name, "object": {{"sha": sha}}}} for name, sha in zip(words[::2], words[1::2])]
else:
    assert method == ("POST" if path == "refs" else "PATCH")
    git("update-ref", fields.get("ref", path), fields["sha"])
    answer = {{}}
print(json.dumps(answer))
"""


def test_the_action_shows_images_from_a_branch_of_their_own(runner: dict[str, str]) -> None:
    folder = Path(runner["RUNNER_TEMP"])
    repository = folder / "repository"
    git = ["git", "-C", str(repository), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run(["git", "init", "-q", "-b", "main", repository], check=True)
    (folder / "bin/gh").write_text(GITHUB.format(python=sys.executable, repository=repository))
    report, summary = folder / "report.md", folder / "summary.md"
    (folder / "work/plots").mkdir()
    images = {"plots/a & b.png": b"one", "worst.webp": b"two"}
    for name, content in images.items():
        (folder / "work" / name).write_bytes(content)
    (folder / "work/table.csv").write_text("time\n0\n")
    written = "\n".join(str(folder / "work" / name) for name in [*images, "table.csv"])
    names = {f"GIT_{who}_{what}": "x" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    variables = {"FILES": written, "REPORT": str(report), "GITHUB_STEP_SUMMARY": str(summary), **names}
    environment = {**runner, **variables, "GITHUB_SERVER_URL": "https://github.com", "GITHUB_RUN_ID": "7"}

    def publish() -> str:
        script = ROOT / "packaging/publish_images.py"
        done = subprocess.run(
            [sys.executable, script], cwd=folder / "work", env=environment, check=True, capture_output=True
        )
        assert done.stdout == b""
        return subprocess.run(
            [*git, "rev-parse", "mjrun-images"], check=True, capture_output=True, text=True
        ).stdout.strip()

    commit = publish()
    for name, content in images.items():
        stored = subprocess.run([*git, "show", f"{commit}:{name}"], check=True, capture_output=True).stdout
        assert stored == content
    address = f"https://github.com/owner/name/blob/{commit}/plots/a%20%26%20b.png?raw=true"
    assert f'<p>plots/a &amp; b.png<br><img src="{address}" alt="plots/a &amp; b.png"></p>' in report.read_text()
    assert report.read_text() == summary.read_text()

    assert subprocess.run([*git, "merge-base", "--is-ancestor", commit, publish()]).returncode == 0


def test_without_permission_the_action_warns_and_goes_on(runner: dict[str, str]) -> None:
    folder = Path(runner["RUNNER_TEMP"])
    (folder / "bin/gh").write_text("#!/bin/sh\necho 'gh: Resource not accessible (HTTP 403)' >&2\nexit 1\n")
    (folder / "worst.png").write_bytes(b"image")
    environment = {**runner, "FILES": str(folder / "worst.png"), "REPORT": str(folder / "report.md")}
    script = ROOT / "packaging/publish_images.py"
    done = subprocess.run([sys.executable, script], env=environment, check=True, capture_output=True, text=True)
    assert done.stdout.startswith("::warning title=Images are not shown::gh: Resource not accessible (HTTP 403)")
    assert not (folder / "report.md").exists()


def test_annotations_are_readable_in_the_report_and_code_ends_no_fence() -> None:
    text = "::error file=a.xml,line=3,title=MJ100 broken::size%0Agive 100%25\n`````"
    report = runpy.run_path(str(ROOT / "packaging/action.py"))["markdown"](["check", "a.xml"], 1, text)
    assert "a.xml:3: MJ100 broken: size\n    give 100%\n" in report
    assert report.endswith("\n`````\n``````\n")


def run_step(runner: dict[str, str], name: str, **variables: str) -> list[str]:
    """Executes the script of a step of the action, and returns what it passed to `gh`."""
    script = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", STEPS[name]["run"]]
    subprocess.run(script, env={**runner, **variables}, check=True, timeout=60)
    return (Path(runner["RUNNER_TEMP"]) / "gh").read_text("utf-8").splitlines()


@pytest.mark.parametrize("code", ["0", "1", "4"])
def test_the_action_ends_with_the_exit_code_of_the_command(code: str, runner: dict[str, str]) -> None:
    script = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", STEPS["Fail if mjrun failed"]["run"]]
    assert subprocess.run(script, env={**runner, "CODE": code}, timeout=60).returncode == int(code)


def test_every_file_states_the_version_and_the_changelog_describes_it() -> None:
    release_check.check_versions()
    assert release_check.notes(release_check.version())


def test_the_recipe_of_conda_has_the_dependencies_of_the_package() -> None:
    project = (ROOT / "pyproject.toml").read_text("utf-8")
    (block,) = re.findall(r"^dependencies = \[\n(.*?)^\]", project, re.DOTALL | re.MULTILINE)
    wanted = set(re.findall(r'"([^"]+)"', block))
    recipe = yaml.safe_load((ROOT / "packaging/recipe.yaml").read_text("utf-8"))
    stated = {each.replace(" ", "") for each in recipe["requirements"]["run"]} - {"python>=${{python_min}}", "__linux"}

    assert {each.replace("mujoco-python", "mujoco") for each in stated} == wanted


def test_the_hook_skips_files_that_are_not_models(tmp_path: Path) -> None:
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text("utf-8"))
    (tmp_path / "package.xml").write_text("<package/>")
    (tmp_path / "part.xml").write_text("<mujocoinclude/>")
    command = [sys.executable, "-m", *hook["entry"].split(), "package.xml", "part.xml"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)

    assert (done.returncode, done.stdout.count("2 files skipped")) == (0, 1), done.stdout
