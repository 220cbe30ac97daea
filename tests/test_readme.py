"""The commands of the README and docs/ are run, at small sizes; their Python is executed."""

import re
import subprocess
import warnings
from contextlib import suppress
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed

from mjrun.document.study import read_study
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from scripts.make_docs import CONTENTS
from tests.conftest import Command
from tests.documentation import (
    PAGES,
    ROOT,
    TEXT,
    Execution,
    blocks,
    commands,
    commands_in_tables,
    shell_environment,
)
from tests.viewer.studio_client import LIMIT, Page, address, browser, payloads

pytestmark = pytest.mark.slow

# tests/test_tutorial.py runs the commands of its page, at full size.
SHELL = blocks("sh", "".join(text for path, text in PAGES.items() if path.name != "tutorial.md"))
PYTHON = blocks("python")
COMMANDS = commands("".join(text for path, text in PAGES.items() if path.name != "tutorial.md"))
DRAWN = [line for line in COMMANDS if line.startswith(("mjrun video", "mjrun image")) or " mjrun video" in line]
# Commands that are only planned: tests/outputs and tests/rendering draw each option, tests/test_gallery.py each scene.
RENDERED = "&&|[|>]|filament|--controller|dm:|menagerie:"
PLANNED = [line for line in DRAWN if not re.search(RENDERED, line) and line not in PAGES[ROOT / "README.md"]]
PLOTS = [line for line in COMMANDS if "mjrun plot" in line and not re.search(r"plot (slides|sliding|fit)", line)]
TABLES = [line for line in COMMANDS if line.startswith(("mjrun trace", "for ")) and line not in (*DRAWN, *PLOTS)]
TABLES = [line for line in TABLES if " chirp.csv" not in line]  # a fit makes it first
IMAGE, SHORT = "--size 64x48 --quality draft", "--duration 0.1"
SMALLER = {
    "video": f"{IMAGE} {SHORT} --fps 20",
    "image": IMAGE,
    "trace": SHORT,
    "run": "videos[0].size=64x48 videos[0].fps=1 images[0].size=64x48 plots[0].size=320x240 --quality draft",
    "view": SHORT,
    "eval": "--episodes 2 --jobs 1",
    "sweep": "--jobs 1",
    "export": SHORT,
    "plot": "--size 320x240",
    "dataset": "--jobs 1 --size 48x36 --quality draft",
    "bench": "--budget 0.05",
}
SMALLER_STUDIES = {
    r"(--duration |duration=)[\d.]+": r"\g<1>0.1",
    r"(--samples |samples=)\d+": r"\g<1>2",
    r"seq 4 \| xargs -P 4 (.*)/4": r"seq 2 | xargs -P 2 \1/2",
    r"\.\.(\S+):\d+'": r"..\1:3'",
    r"slid > 0.01": "slid >= 0",
    # Another block makes this study.
    r"^mjrun sweep drift --(status|gc --dry-run)\n": r"mjrun sweep scenes/pendulum.xml --steps 2 "
    r"--vary joint/hinge.damping=1,2 --metric 'late=max(time)' -o drift\n\g<0>",
}
# Every column is plotted without --y, see tests/plotting/test_figure_plan.py.
SMALLER_PLOTS = {
    r"--duration \d+": "--duration 0.5",
    r"--samples \d+": "--samples 3",
    r" -o (squat|level)\.png| --html swing\.html": r" --y energy/total\g<0>",
    r"mjrun plot findings\.csv": r"mjrun check -q --scan scenes/arm.xml scenes/swing.xml --table findings.csv && \g<0>",
}
DOCUMENTS = [line for line in COMMANDS if line.startswith(("mjrun run", "mjrun schema"))]
DOCUMENTS = [line for line in DOCUMENTS if f"{line} --html" not in TEXT]  # of which the page has all outputs, too
PLOTTED = {
    "flip.csv": ("tippe_top", "qvel[top],xpos[stem]"),
    "weight.csv": ("free_body", "contact,contact_force,penetration,qvel,qacc"),
    "blows.csv": ("pinata", "sensor,contact"),
    **{f"kick_{seed}.csv": ("chaotic_pendulum", "qpos[root],energy") for seed in (1, 2)},
    **{f"energy_{timestep}.csv": ("chaotic_pendulum", "energy") for timestep in (0.01, 0.001)},
}
VIEWS = [line for line in (*COMMANDS, *commands_in_tables(TEXT)) if line.startswith("mjrun view")]
# In a browser: tests/cli/commands/test_view.py has the window and the other options.
VIEWS = [line for line in VIEWS if "--browser" in line]
# A table, a summary and a baseline need findings, not many models: only the first of these commands checks all scenes.
FEWER = {
    "check scenes/ --": "check scenes/pinata.xml scenes/swing.xml --",
    "scan scenes/ --": "scan scenes/pinata.xml --",
}
ANSWERS = [line for line in COMMANDS if line.startswith(("mjrun info", "mjrun check", "mjrun bench"))]
ANSWERS = [line for line in ANSWERS if "--policy" not in line]  # tests/test_gallery.py checks tasks with policies


FITS = [block for block in SHELL if "mjrun fit" in block and "--excite" not in block]
EXCITED = [block for block in SHELL if "--excite" in block]
EVALUATIONS = [line for line in COMMANDS if line.startswith("mjrun eval")]
STUDIES = [block for block in SHELL if block.startswith("mjrun sweep") and "-o sliding" not in block]  # it is slides
STUDIES = [block for block in STUDIES if "--engine slurm" not in block]  # tests/study/test_executors.py submits jobs
DATASETS = [line for line in COMMANDS if line.startswith("mjrun dataset")]
EXPORTS = [line for line in COMMANDS if line.startswith("mjrun export") and "--format" not in line]
EPISODES = [block for block in SHELL if re.search("--format (lerobot|minari)", block)]
# Without other exports, and once for each format of a policy's episodes.
EPISODES = [re.sub("^mjrun export (?!.*--format).*\n", "", block, flags=re.MULTILINE) for block in EPISODES]
EPISODES = [*{re.sub("--camera .*", "", block): block for block in EPISODES}.values()]
DIFFERENCES = [line for line in COMMANDS if line.startswith(("mjrun diff", "sed "))]


@pytest.fixture
def shell(tmp_path: Path) -> dict[str, str]:
    """A shell whose `mjrun` makes every video small, in a folder with the scenes."""
    return shell_environment(tmp_path, SMALLER)


@pytest.fixture
def drawn_plain(shell: dict[str, str], plain: Path, tmp_path: Path) -> None:
    """Replaces the scenes in that folder by plain ones."""
    (tmp_path / "scenes").unlink()
    (tmp_path / "scenes").symlink_to(plain)


@pytest.fixture
def execute(shell: dict[str, str], mjrun_here: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Execution:
    """Executes command lines in that folder, at small sizes."""
    monkeypatch.chdir(tmp_path)
    return Execution(tmp_path, mjrun_here, shell, SMALLER)


def test_brackets_are_in_quotes_which_zsh_wants() -> None:
    for command in [*COMMANDS, *re.findall(r"`(pip install [^`]*)`", TEXT)]:
        assert not re.search(r"[\[\]]", re.sub(r"'[^']*'|\"[^\"]*\"|\$\([^)]*\)", "", command))


def test_the_readme_has_the_commands_that_it_is_for() -> None:
    assert len(DRAWN) >= 20
    assert {"make demo", "make test", "mjrun doctor"} <= set(COMMANDS)
    assert len(PYTHON) == 6


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.parametrize("command", [command for command in DRAWN if command not in PLANNED])
def test_a_video_or_image_of_the_readme_is_made(
    command: str, execute: Execution, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if "filament" in command:
        request.getfixturevalue("vulkan")
    before = set(tmp_path.iterdir())
    done = execute(command)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr
    assert set(tmp_path.iterdir()) != before or done.stdout.strip().isdigit()


@pytest.mark.gl
@pytest.mark.parametrize("command", PLANNED)
def test_a_video_or_image_of_the_pages_finds_all_that_it_names(command: str, execute: Execution) -> None:
    done = execute.planned(command)
    assert (done.returncode, "error" in done.stderr) == (0, False), done.stderr


@pytest.mark.parametrize("command", TABLES)
def test_a_table_of_the_readme_is_made(command: str, execute: Execution, tmp_path: Path) -> None:
    before = set(tmp_path.iterdir())
    done = execute(command)
    expected = ("mjrun: the episode of seed 0 has not", "mjrun: untrusted: ")
    remarks = [line for line in done.stderr.splitlines() if not line.startswith(expected)]
    assert (done.returncode, remarks) == (0, [])
    assert set(tmp_path.iterdir()) != before or done.stdout.startswith(("time", "groups of columns"))


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with short tables that have the names, models and probes of the README."""
    folder = tmp_path_factory.mktemp("tables")
    for seed, (name, (scene, probe)) in enumerate(PLOTTED.items()):
        simulation = Simulation(ROOT / f"scenes/{scene}.xml", duration=0.1, perturb=0.01, seed=seed)
        Trace(simulation, str(folder / name), probe=probe.split(",")).run()
    return folder


@pytest.mark.parametrize("command", PLOTS)
def test_a_plot_of_the_readme_is_made(command: str, execute: Execution, tables: Path, tmp_path: Path) -> None:
    for table in tables.iterdir():
        (tmp_path / table.name).symlink_to(table)
    for long, short in SMALLER_PLOTS.items():
        command = re.sub(long, short, command)
    done = execute(command)
    (output,) = re.findall(r" plot .*?(?:-o|--html) (\S+)", command)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / output).stat().st_size > 1000
    notes = done.stderr.splitlines()
    short = ("are not on a logarithmic axis", "no values to draw", "0.288")  # there is no contact yet
    assert all(any(each in note for each in short) for note in notes), notes


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.parametrize("command", DOCUMENTS)
def test_a_document_of_the_readme_is_run(command: str, execute: Execution, tmp_path: Path) -> None:
    before = set(tmp_path.iterdir())
    done = execute(command)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr
    assert set(tmp_path.iterdir()) != before or "--dry-run" in command


@pytest.mark.parametrize("command", ANSWERS)
def test_a_question_of_the_readme_is_answered(command: str, execute: Execution, tmp_path: Path) -> None:
    for all_scenes, few in FEWER.items():
        command = command.replace(all_scenes, few)
    done = execute(command)
    assert (done.returncode, bool(done.stdout)) == (0, True), done.stderr


@pytest.mark.parametrize("command", DIFFERENCES)
def test_a_comparison_of_the_readme_has_a_verdict(command: str, execute: Execution, tmp_path: Path) -> None:
    done = execute(command)
    assert (done.returncode, done.stderr) == (int(command.startswith("sed ")), "")
    if command.startswith("sed "):
        assert done.stdout in TEXT
    else:
        assert " agree: " in done.stdout


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.parametrize("commands", STUDIES, ids=range(len(STUDIES)))
def test_studies_of_the_readme_make_their_tables(commands: str, execute: Execution, tmp_path: Path) -> None:
    for long, short in SMALLER_STUDIES.items():
        commands = re.sub(long, short, commands)
    done = execute(commands)
    assert done.returncode == 0, done.stderr
    for folder in re.findall(r" -o (\w+)(?![\w.])", commands):
        assert (tmp_path / folder / "results.parquet").exists()


@pytest.mark.parametrize("command", EXPORTS)
def test_an_export_of_the_readme_is_made(command: str, execute: Execution, tmp_path: Path) -> None:
    shorter = command.replace(" --steps 1", "")  # which a duration contradicts
    done = execute(shorter)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / command.split(" -o ")[1].split()[0]).stat().st_size > 1000


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.gl
@pytest.mark.parametrize("block", EPISODES)
def test_a_dataset_of_episodes_of_the_readme_is_made(block: str, execute: Execution, tmp_path: Path) -> None:
    few = re.sub(r"--episodes \d+", "--episodes 1 --jobs 1 --size 48x36 --quality draft", block)
    done = execute("\n".join(line for line in few.splitlines() if not line.startswith("pip ")))
    assert done.returncode == 0, done.stderr
    assert [*tmp_path.glob("*/mjrun/dataset.json")]


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.parametrize("command", DATASETS)
def test_a_dataset_of_the_readme_has_its_images(command: str, execute: Execution, tmp_path: Path) -> None:
    for long, short in SMALLER_STUDIES.items():
        command = re.sub(long, short, command)
    done = execute(command)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / command.split(" -o ")[1].split()[0]
    assert list(folder.rglob("000000.png"))


@pytest.mark.parametrize("commands", FITS, ids=range(len(FITS)))
def test_a_fit_of_the_readme_finds_what_its_log_was_made_with(
    commands: str, execute: Execution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SMALLER, "trace", "")  # in a tenth of a second nothing swings
    done = [execute(line) for line in commands.replace("\\\n", " ").splitlines()]
    assert [each.returncode for each in done] == [0] * len(done)
    assert re.search(r"joint/hinge.damping \[N·m·s/rad\] +0 +0.2 ", done[1].stdout)
    assert (tmp_path / "fit.png").exists()


@pytest.mark.parametrize("commands", EXCITED, ids=range(len(EXCITED)))
def test_an_excitation_of_the_readme_can_be_played(commands: str, execute: Execution, tmp_path: Path) -> None:
    lines = commands.replace("\\\n", " ").replace("--duration 5", "--duration 1").splitlines()
    done = [execute(line) for line in lines]
    assert [each.returncode for each in done] == [0] * len(done)
    assert (tmp_path / "excited.csv").exists()


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.gl
@pytest.mark.parametrize("command", EVALUATIONS)
def test_an_evaluation_of_the_readme_has_its_table(command: str, execute: Execution, tmp_path: Path) -> None:
    small = re.sub(r"--videos \w+", rf"\g<0> --fps 1 {IMAGE}", command)
    done = execute(re.sub(r"(=[\d.]+,[\d.]+)(,[\d.]+)+'", r"\1'", small))  # with two values of each parameter
    assert done.returncode == 0, done.stderr
    folder = tmp_path / command.split()[-1]
    assert (folder / "episodes.csv").exists()
    assert len(list(folder.glob("*.mp4"))) == (2 if "--videos 3" in command else 0)  # of two episodes


def test_the_study_document_of_the_readme_is_one(tmp_path: Path) -> None:
    (text,) = (block for block in blocks("yaml") if re.search("^model:(.|\n)*^vary:", block, re.MULTILINE))
    (tmp_path / "study.yaml").write_text(text.replace("../humanoid.xml", str(ROOT / "scenes/humanoid.xml")))
    request = read_study(tmp_path / "study.yaml", ["samples=2", "duration=0.01"])
    with request.located():
        assert request.made.preview().points == 2 * 8 * 2


@pytest.mark.usefixtures("drawn_plain")
@pytest.mark.gl
@pytest.mark.parametrize("command", VIEWS)
def test_a_view_of_the_readme_opens_and_ends(
    command: str, shell: dict[str, str], tmp_path: Path, display: dict[str, str]
) -> None:
    arguments = ["sh", "-ec", command]
    with subprocess.Popen(arguments, cwd=tmp_path, env={**shell, **display}, stderr=subprocess.PIPE) as view:
        assert view.stderr
        page = Page(address(view.stderr.readline().decode()))
        # It may be over before the first state is fetched.
        with suppress(ConnectionClosed), browser(page) as states:
            next(payloads(states))
        assert view.wait(LIMIT) == 0


@pytest.mark.parametrize("command", [line for line in COMMANDS if line.startswith("make")])
def test_the_targets_of_the_readme_exist(command: str) -> None:
    done = subprocess.run([*command.split(), "--dry-run"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(not (ROOT / ".venv/mjrun-can-draw").exists(), reason="set up by hand, not by make")
def test_the_demo_makes_its_video_and_says_where_it_is() -> None:
    video = ROOT / "out/dominos.mp4"
    video.unlink(missing_ok=True)
    small = "ARGS=--duration 0.1 --size 320x180"
    done = subprocess.run(["make", "demo", small], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert f"The video is {video}" in done.stdout.splitlines()
    assert video.stat().st_size > 3000


def test_every_other_command_of_the_readme_is_known() -> None:
    names = "video|image|dataset|export|trace|plot|run|schema|info|check|bench|diff|view|sweep|eval|fit"
    packages = r"pip install ('?\.|mujoco-menagerie|'mjrun\[)|mujoco-menagerie "
    known = rf"mjrun ({names}) |mjrun doctor|for |make |{packages}|cat |seq |sed |eval |echo "
    assert all(re.match(known, command) for command in COMMANDS)


def test_the_python_of_the_readme_makes_its_outputs(
    tmp_path: Path, plain: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scenes").symlink_to(plain)
    small = "\n".join(PYTHON).replace("duration=7", "duration=0.1").replace("time=3.7", "time=0.05")
    small = small.replace('camera="closeup"', 'camera="closeup", size=(64, 48)')
    assert (small.count("0.1"), small.count("0.05"), small.count("size=(64")) == (2, 1, 3)
    small += 'assert (depth.shape, str(depth.dtype), unit) == ((240, 320), "float32", "J")'
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings(action="ignore"):
        exec(small, {"__name__": "__main__"})
    assert capfd.readouterr() == ("", "")
    names = ("top.mp4", "tippe_top.mp4", "tippe_top.png", "tippe_top.npz", "small.webm")
    assert all((tmp_path / name).stat().st_size > 0 for name in names)


def test_images_of_the_pages_exist_and_are_small() -> None:
    for path, text in PAGES.items():
        for image in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text):
            assert 0 < (path.parent / image).stat().st_size < 200_000


def anchors(page: Path) -> set[str]:
    """Returns the anchors of the headings of a page, as GitHub makes them."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_between_pages_lead_somewhere() -> None:
    for page, text in PAGES.items():
        for target, _, anchor in re.findall(r"\]\((?!https?:)([^)#]*)(#([^)]*))?\)", text):
            other = page.parent / target if target else page
            assert other.exists(), f"{page}: {target}"
            assert not anchor or anchor in anchors(other), f"{page}: {target}#{anchor}"


def test_files_that_pages_name_exist() -> None:
    for name in re.findall(r"`((?:tests|scripts|benchmarks|scenes|packaging)/[\w/.]+)`", TEXT):
        assert (ROOT / name).exists(), name
    for name in re.findall(r"\| `(\w+\.py)`", TEXT):
        assert (ROOT / "benchmarks" / name).exists(), name


def test_the_readme_is_short_and_leads_to_every_guide() -> None:
    readme = PAGES[ROOT / "README.md"]
    assert len(readme.splitlines()) <= 250
    guides = [name for part in ("Begin", "By task", "Guides") for name in CONTENTS[part] if name != "gallery"]
    assert [name for name in ("index", *guides) if not re.search(rf"\(docs/{name}\.(md|ipynb)\)", readme)] == []
