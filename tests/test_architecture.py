"""The architecture of mjrun: which module may import which, checked on every import."""

import ast
import inspect
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FrameType

import pytest

import mjrun
from mjrun.cli.console import Console
from mjrun.cli.main import COMMANDS
from tests.cases import cases
from tests.syntax_trees import nodes_of, parsed

# Imports run downward. Rooms on one line are siblings and never import each other.
HOUSE = (
    ("__main__", "pytest_plugin"),
    ("cli", "gym", "in_memory"),
    ("document", "python_help"),
    ("doctor", "check", "bench", "fitting", "evaluation", "viewer"),
    ("study",),
    ("experiment",),
    ("outputs",),
    ("simulation",),
    ("rendering", "plotting", "diff", "policy"),
    ("task",),
    ("physics", "probe", "camera", "formats"),
    ("scene_graph",),
    ("worker",),
    ("model",),
    ("options", "child_process"),
    ("python_code", "hdf5"),
    ("reporter", "confinement", "decompression_limits", "packages"),
    ("timeline", "errors", "palette", "shared_status", "version", "file_version", "suffixes"),
    ("platform", "dataclass"),
)

# Modules in which each library may be imported; libraries that are not listed may not be imported.
LIBRARIES = {
    "click": ("cli",),
    "rich": ("cli",),
    "pytest": ("pytest_plugin",),
    "yaml": ("document", "policy.loaders.leapp"),  # the latter reads files of other programs
    "imageio": ("formats.image_and_video_reader",),
    "imageio_ffmpeg": ("formats.ffmpeg", "formats.image_and_video_reader"),
    "PIL": (
        "rendering.text",
        "rendering.live_plot",
        "formats.image_encoding",
        "formats.image_and_video_reader",
    ),
    "mcap": ("formats.mcap",),
    "pxr": ("formats.usd",),  # OpenUSD
    "google": ("formats.mcap",),  # protobuf
    "foxglove_schemas_protobuf": ("formats.mcap",),
    "matplotlib": ("plotting",),
    "contourpy": ("formats.datasets.coco",),
    "coacd": ("check.rules.decomposition_fix",),
    "h5py": ("formats.tables.hdf5", "formats.episodes.minari", "hdf5"),
    "skimage": ("diff",),
    "orjson": ("formats.number_text", "formats.tables"),
    "pyarrow": (
        "formats.arrow_columns",
        "formats.tables",
        "formats.episodes.lerobot",
        "formats.study_reader",
        "study.part_files",
    ),
    "cloudpickle": ("python_code",),
    "fsspec": ("formats.local_and_remote_folders",),
    "distributed": ("study.clusters",),
    "ray": ("study.clusters",),
    "submitit": ("study.clusters",),
    "scipy": (
        "formats.tables.mat",
        "experiment.statistics",
        "physics.random_distribution",
        "experiment.samplers",
        "plotting.study.statistics",
        "fitting",
    ),
    "onnx": ("policy",),
    "onnxruntime": ("policy",),
    "stable_baselines3": ("policy", "gym.stable_baselines"),
    "torch": ("policy", "gym.rsl_rl"),
    "rsl_rl": ("gym.rsl_rl",),
    "tensordict": ("gym.rsl_rl",),
    "gymnasium": ("gym", "model.sources.gym", "task.external_environment"),
    "OpenGL": ("rendering",),
    "warp": ("physics.warp_device",),
    "mujoco_warp": ("physics.warp_device",),
    "mujoco": (
        *("cli", "gym", "in_memory", "doctor", "check", "bench", "fitting", "study", "evaluation", "viewer"),
        *("experiment", "outputs", "simulation"),
        *("rendering", "plotting", "diff", "policy", "task", "physics", "probe", "camera", "formats"),
        *("scene_graph", "model"),
    ),
    "numpy": (
        *("cli", "gym", "in_memory", "doctor", "check", "bench", "fitting", "study", "evaluation", "viewer"),
        *("experiment", "outputs", "simulation"),
        *("rendering", "plotting", "diff", "policy", "task", "physics", "probe", "camera", "formats"),
        *("scene_graph", "model", "hdf5"),
    ),
}

PACKAGE = Path(mjrun.__file__).parent
LEVEL = {room: level for level, rooms in enumerate(HOUSE) for room in rooms}


def imported(nodes: Iterable[ast.AST], home: str) -> Iterator[tuple[int, str]]:
    """Yields line and dotted name of each module that `home` imports anywhere, or names in a string."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = home.split(".")[: -node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                if base == "mjrun":
                    yield node.lineno, mjrun._HOMES.get(alias.name, f"mjrun.{alias.name}")
                else:
                    yield node.lineno, base
        elif isinstance(node, ast.Constant) and re.fullmatch(r"mjrun(\.(?!toml)\w+)+", str(node.value)):
            yield node.lineno, str(node.value)


IMPORT = re.compile(r"^[ \t]*(from mjrun[\w.]* import (?:\([^)]*\)|.*)|import mjrun.*)", re.MULTILINE)


def imported_names(source: str) -> set[str]:
    """Returns all modules that a test imports or names: `from mjrun.probe import parser` is `mjrun.probe.parser`."""
    names = set(re.findall(r"\bmjrun(?:\.\w+)+", source))
    names |= {mjrun._HOMES.get(name, "") for name in re.findall(r"\bmjrun\.(\w+)", source)}
    for statement in IMPORT.findall(source):
        nodes = list(ast.walk(ast.parse(statement)))
        names |= {name for _, name in imported(nodes, "tests")}
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and node.module:
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def lives_in(module: str, homes: tuple[str, ...]) -> bool:
    return any(module == home or module.startswith(f"{home}.") for home in homes)


def fault(module: str, target: str) -> str | None:
    """Returns the reason why `module` (without `mjrun.`) must not import `target`; None if it may."""
    top, _, inner = target.partition(".")
    if top in sys.stdlib_module_names:
        return None
    if top != "mjrun":
        allowed = LIBRARIES.get(top)
        if allowed is None:
            return "is not in the table of libraries"
        return None if lives_in(module, allowed) else f"is at home in {', '.join(allowed)} only"
    mine, other = module.partition(".")[0], inner.partition(".")[0]
    if mine == other:
        return None
    for room in (mine, other):
        if room not in LEVEL:
            return f"{room or 'the package itself'!r} is not a room of the house"
    if LEVEL[mine] == LEVEL[other]:
        return "is a sibling"
    return None if LEVEL[mine] < LEVEL[other] else "is above"


def violations(package: Path) -> list[str]:
    """Returns all imports in `package` that the tables do not allow."""
    found = []
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        module = ".".join(part for part in parts if part != "__init__")
        if not module:
            continue  # mjrun/__init__.py, whose lazy table names every room
        for line, target in imported(nodes_of(path), ".".join(("mjrun", *parts))):
            if reason := fault(module, target):
                found.append(f"{path.relative_to(package)}:{line} imports {target}, which {reason}")
    return found


def test_imports_run_one_way_and_every_library_has_one_home() -> None:
    assert violations(PACKAGE) == []


@cache
def room_of(code: CodeType) -> str | None:
    """Returns the room of a function; None outside of mjrun."""
    path = Path(code.co_filename)
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py") if path.is_relative_to(PACKAGE) else None


def upward_calls(action: Callable[[], object]) -> set[tuple[str, str]]:
    """Returns the rooms of callers and functions called in `action` where the caller is below the function.

    A generator that is handed down and read there counts as a value, and so does what an import runs. The methods that
    all dataclasses share count as methods of their class.
    """
    pairs: set[tuple[str, str]] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event != "call" or not room_of(frame.f_code) or frame.f_code.co_flags & inspect.CO_GENERATOR:
            return
        chain = [frame]
        while above := chain[-1].f_back:
            chain.append(above)
        ours = [(room, each.f_code.co_name) for each in chain if (room := room_of(each.f_code))]
        if len(ours) > 1 and all(name != "<module>" for _, name in ours):
            (called, _), (caller, _), *_ = ours
            if LEVEL[called] < LEVEL[caller] and caller != "dataclass":
                pairs.add((caller, called))

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return pairs


def test_a_video_calls_upward_only_its_reporter(swing: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(swing, steps=5)
    video = mjrun.Video(simulation, str(tmp_path / "a.mp4"), size=(64, 48), jobs=1)
    assert upward_calls(lambda: video.run(Console())) == {("outputs", "cli")}


def test_the_guide_names_every_package() -> None:
    table = (PACKAGE.parent / "CONTRIBUTING.md").read_text("utf-8").partition("| package |")[2].partition("\n\n")[0]
    packages = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    assert set(re.findall(r"`(\w+)/`", table)) == packages


def test_the_modules_to_read_exist_and_are_few() -> None:
    guide = (PACKAGE.parent / "CONTRIBUTING.md").read_text("utf-8").partition("## Read\n")[2].partition("\n## ")[0]
    modules = re.findall(r"`([\w/]+\.py)`", guide)
    assert [module for module in modules if not (PACKAGE / module).is_file()] == []
    assert 30 < len(set(modules)) <= 45


def plant(folder: Path, module: str, source: str) -> Path:
    """Writes a package of one module; returns its folder."""
    path = folder / "mjrun" / module
    path.parent.mkdir(parents=True)
    path.write_text(source)
    return folder / "mjrun"


@cases("module, source")
def test_a_planted_bad_import_is_found(tmp_path: Path, module: str, source: str) -> None:
    found = violations(plant(tmp_path, module, source))
    assert len(found) == 1
    assert found[0].startswith(f"{module}:")


@cases("module, source")
def test_a_planted_good_import_is_allowed(tmp_path: Path, module: str, source: str) -> None:
    assert violations(plant(tmp_path, module, source)) == []


def test_a_test_of_its_room_imports_every_module_or_has_its_name() -> None:
    tests = Path(__file__).parent
    missing: list[str] = []
    for room in sorted({path.relative_to(PACKAGE).parts[0] for path in PACKAGE.rglob("[!_]*.py")}):
        folder, pattern = (tests, "*.py") if room.endswith(".py") else (tests / room, "**/*.py")
        names = {name for path in folder.glob(pattern) for name in imported_names(path.read_text("utf-8"))}
        modules = [PACKAGE / room] if room.endswith(".py") else (PACKAGE / room).rglob("[!_]*.py")
        for module in modules:
            within = module.relative_to(PACKAGE)
            dotted = ".".join(("mjrun", *within.with_suffix("").parts))
            if dotted not in names and not (tests / within.with_name(f"test_{within.name}")).exists():
                missing.append(dotted)
    assert sorted(missing) == []


def test_every_constant_is_used() -> None:
    paths = sorted(PACKAGE.rglob("*.py"))
    words = Counter(word for path in paths for word in re.findall(r"\w+", path.read_text("utf-8")))
    unused: list[str] = []
    for path in paths:
        for node in parsed(path).body:
            if isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = {each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)}
                if names and all(words[name] == 1 for name in names):
                    unused.append(f"{path.relative_to(PACKAGE)}:{node.lineno} {', '.join(names)}")
    assert unused == []


def test_no_function_has_two_docstrings() -> None:
    doubled = [
        f"{path.relative_to(PACKAGE)}:{node.lineno} {node.name}"
        for path in PACKAGE.rglob("*.py")
        for node in nodes_of(path)
        if isinstance(node, ast.FunctionDef)
        and sum(isinstance(each, ast.Expr) and isinstance(getattr(each.value, "value", 0), str) for each in node.body)
        > 1
    ]
    assert doubled == []


@pytest.mark.parametrize("name", mjrun.__all__)
def test_every_public_name_is_where_the_lazy_table_says(name: str) -> None:
    assert getattr(mjrun, name) is not None
    assert name in dir(mjrun)


def test_a_name_that_is_not_public_is_missing_as_from_any_module() -> None:
    with pytest.raises(AttributeError, match=r"module 'mjrun' has no attribute 'Vido'"):
        _ = mjrun.Vido  # type: ignore[attr-defined]


def loaded_by(code: str) -> set[str]:
    """Returns the modules that a new interpreter has loaded after `code`."""
    code = f"import sys\ntry:\n    {code}\nexcept SystemExit as end:\n    assert not end.code\n"
    command = [sys.executable, "-c", code + "print(*sys.modules, file=sys.stderr)"]
    return set(subprocess.run(command, capture_output=True, text=True, check=True).stderr.split())


def command_line(*arguments: str) -> str:
    return f"sys.argv = {['mjrun', *arguments]!r}; import runpy; runpy.run_module('mjrun', run_name='__main__')"


@pytest.mark.parametrize("code", ["import mjrun", command_line("--help"), command_line("--version")])
def test_import_help_and_version_load_neither_mujoco_nor_numpy(code: str) -> None:
    loaded = loaded_by(code)
    assert "mjrun" in loaded
    assert loaded.isdisjoint({"mujoco", "numpy"})


# Modules of the standard library that are slow to import, and that help and completion do not need.
SLOW_MODULES = {
    *("difflib", "email", "html.entities", "http.client", "importlib.metadata", "json", "logging", "ssl", "traceback")
}
COMPLETION = "import os; os.environ |= {'_MJRUN_COMPLETE': 'bash_complete', 'COMP_LINE': 'mjrun trace --st'}; "


@pytest.mark.parametrize(
    "code",
    [command_line("--help"), command_line("--version"), COMPLETION + command_line("")],
    ids=["help", "version", "completion"],
)
def test_help_version_and_completion_load_no_slow_module(code: str) -> None:
    loaded = loaded_by(code)
    assert "mjrun.cli.main" in loaded
    assert loaded.isdisjoint({"mujoco", "numpy", *SLOW_MODULES})


def test_completion_does_not_load_what_wraps_help() -> None:
    loaded = loaded_by(COMPLETION + command_line(""))
    assert "mjrun.cli.click_command" in loaded
    assert "textwrap" not in loaded


def test_a_run_of_tables_starts_without_images_and_plots(tmp_path: Path) -> None:
    document = tmp_path / "run.yaml"
    document.write_text("{model: scene:pendulum, steps: 1, traces: [{output: t.csv}]}")
    loaded = loaded_by(command_line("run", str(document), "-o", str(tmp_path)))
    assert {"mujoco", "mjrun.outputs.trace"} <= loaded
    rooms = {module.split(".")[1] for module in loaded if module.startswith("mjrun.")}
    assert rooms.isdisjoint({"rendering", "plotting", "diff", "check", "bench"})
    assert loaded.isdisjoint({"PIL", "http.client", "numpy.random"})


def test_a_check_of_what_has_not_changed_loads_neither_mujoco_nor_numpy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MJRUN_CACHE", str(tmp_path / "cache"))
    model = tmp_path / "model.xml"
    model.write_text("<mujoco/>")
    check = command_line("check", "--steps", "0", str(model))
    loaded_by(check)
    loaded = loaded_by(check)
    assert "mjrun.check.result_cache" in loaded
    assert loaded.isdisjoint({"mujoco", "numpy"})


def test_help_of_commands_loads_no_library_but_click() -> None:
    code = f"from mjrun.cli.main import run; [run([name, '--help']) for name in {[*COMMANDS]}]"
    loaded = loaded_by(code)
    assert {f"mjrun.cli.commands.{name}" for name in COMMANDS} <= loaded
    assert loaded.isdisjoint(set(LIBRARIES) - {"click"} | {"json"})


def test_a_trace_starts_without_what_it_does_not_use(tmp_path: Path) -> None:
    loaded = loaded_by(command_line("trace", "scene:pendulum", "--steps", "1", "-o", str(tmp_path / "t.csv")))
    assert {"mujoco", "mjrun.outputs.trace"} <= loaded
    rooms = {module.split(".")[1] for module in loaded if module.startswith("mjrun.")}
    assert rooms.isdisjoint({"rendering", "camera", "document", "plotting", "diff", "check", "bench"})
    unused = (
        "probe.parser",
        "probe.row_expression",
        "simulation.mapped_table",
        "physics.kinematic_samples",
        "formats.codecs",
    )
    assert loaded.isdisjoint(f"mjrun.{module}" for module in unused)


def test_using_a_public_name_loads_what_it_needs() -> None:
    assert {"mujoco", "numpy"} <= loaded_by("import mjrun; mjrun.load")
