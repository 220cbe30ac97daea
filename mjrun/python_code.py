"""Loading of Python code that the user names, `FILE.py:NAME` or `PACKAGE.MODULE:NAME`; no other code is loaded."""

import ast
import contextlib
import copy
import hashlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import inspect
import io
import os
import pickle
import re
import site
import sys
import sysconfig
from collections.abc import Callable, Generator, Iterable, Sequence
from functools import cache, reduce
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NoReturn, TypeVar, cast

from mjrun.confinement.confinement import require_unconfined
from mjrun.dataclass import dataclass
from mjrun.errors import ControllerError, FileError, UnknownNameError, UsageError, clean, option, quoted
from mjrun.packages import packages_of, require

T = TypeVar("T")
CODE_REMEDY = "an object of a class is copied for each, and a policy can seed its random numbers in reset(seed)"


class RedirectedFunction:
    """A function, with its `reset`, whose prints go to standard error, as standard output carries the payload.

    Attributes:
      forwards_to: the function, which gets all arguments.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        self.forwards_to = self.__wrapped__ = function
        self.__qualname__ = getattr(function, "__qualname__", type(function).__qualname__)
        with contextlib.suppress(ValueError):
            self.__signature__ = inspect.signature(function)
        if hasattr(function, "reset"):
            self.reset = RedirectedFunction(function.reset)  # type: ignore[attr-defined]

    def __call__(self, *arguments: object, **keywords: object) -> object:
        output, sys.stdout = sys.stdout, sys.stderr
        try:
            return self.forwards_to(*arguments, **keywords)
        finally:
            sys.stdout = output


@contextlib.contextmanager
def same_working_directory() -> Generator[None]:
    """Returns to the working directory where code has left it, as code that reads its own files may.

    Otherwise relative paths of the user's would mean other files from then on.
    """
    before = Path.cwd()
    try:
        yield
    finally:
        os.chdir(before)


@dataclass(frozen=True)
class ModuleSource:
    """The source of a module of the user's.

    Attributes:
      path: the path of its file, which need not exist where the module is imported.
    """

    name: str
    path: str
    content: bytes


@dataclass(frozen=True)
class PickledWithCode:
    """A pickled value with the source of the user's code in it, to be opened by another process, perhaps elsewhere.

    The code that runs there is the code as it was when the value was pickled, whatever the files hold by then.
    """

    payload: bytes
    modules: tuple[ModuleSource, ...]

    @classmethod
    def of(cls, value: object, code: Iterable[object]) -> "PickledWithCode":
        """Pickles a value with the source of its code.

        Args:
          code: the functions and objects in it that are written by the user.

        Raises:
          UsageError: something in it cannot be pickled.
          MissingExtraError: it has functions or classes that cannot be imported, and cloudpickle is not installed.
        """
        return cls(_by_reference(value) or _by_value(value), module_sources(code))

    def open(self) -> object:
        """Returns the value. Modules that this process has not imported yet are made from the pickled sources."""
        import_from(self.modules)
        return pickle.loads(self.payload)


def _by_reference(value: object) -> bytes:
    """Pickles a value; returns nothing if it has functions or classes that another process could not import."""
    with contextlib.suppress(Exception):  # of whatever kind: AttributeError of a lambda, PicklingError
        content = pickle.dumps(value)
        return b"" if b"__main__" in content else content
    return b""


def _by_value(value: object, *, is_hashed: bool = False) -> bytes:
    """Pickles a value with its functions and classes, and with everything that these refer to.

    Args:
      is_hashed: leaves out what differs from process to process, such as the file of a cell of a notebook.
    """
    require("code that cannot be imported", "sweep", "cloudpickle")
    import cloudpickle

    class ContentPickler(cloudpickle.Pickler):
        def reducer_override(self, obj: object) -> Any:
            if isinstance(obj, CodeType):
                return self.dispatch_table[CodeType](_without_place(obj))
            reduced: Any = super().reducer_override(obj)
            if reduced is NotImplemented or not isinstance(obj, type | FunctionType):
                return reduced
            function, arguments, *state = reduced
            return function, tuple(map(_same_in_all_processes, arguments)), *state

    try:
        if not is_hashed:
            return cloudpickle.dumps(value)
        ContentPickler(stream := io.BytesIO()).dump(value)
        return stream.getvalue()
    except Exception as error:
        raise UsageError(
            f"other processes cannot receive what is to be simulated: {clean(str(error))}\n"
            "objects of the code cannot be copied; a text FILE.py:NAME names code that each process loads"
        ) from None


def _same_in_all_processes(argument: object) -> object:
    """Returns an argument that makes a function or a class, without its random identifier and its file."""
    if isinstance(argument, dict):
        entries = cast("dict[str, object]", argument)
        return {name: value for name, value in entries.items() if name != "__file__"}
    return "" if isinstance(argument, str) and re.fullmatch("[0-9a-f]{32}", argument) else argument


def _without_place(code: CodeType) -> CodeType:
    """Returns code without its file and line; sets in it, whose order differs from process to process, are sorted."""
    ordered = tuple(map(_ordered, code.co_consts))
    return code.replace(co_filename="", co_firstlineno=1, co_consts=ordered)


def _ordered(constant: object) -> object:
    return tuple(sorted(cast("frozenset[object]", constant), key=repr)) if isinstance(constant, frozenset) else constant


def import_from(sources: Sequence[ModuleSource]) -> None:
    """Lets this process import modules from sources rather than from their files, from now on."""
    if sources:
        sys.meta_path.insert(0, _PickledModules(sources))


def module_sources(code: Iterable[object], known: Iterable[ModuleSource] = ()) -> tuple[ModuleSource, ...]:
    """Returns the sources of the modules that hold the user's code, and of the modules that they import.

    Installed packages and modules without a Python file are left out; so is `__main__`, which cannot be imported.

    Args:
      code: functions, objects, and texts `FILE.py:NAME` or `PACKAGE.MODULE:NAME`.
      known: sources that were read before, and count whatever their files hold by now.
    """
    by_path = {source.path: source for source in known}
    sources: dict[str, ModuleSource] = {}
    waiting = [_home(each) for each in code]
    while waiting:
        name, path = waiting.pop()
        path = path or _file_of(name)
        if path in sources or name == "__main__" or not _is_users(path):
            continue
        with contextlib.suppress(OSError, SyntaxError, ValueError):  # of a file that cannot be imported either
            source = by_path.get(path) or ModuleSource(name, path, _content(name, path))
            waiting += [(each, "") for each in _imported(source.content, name)]
            sources[path] = source
    return tuple(sources[path] for path in sorted(sources))


def imported_packages(code: Iterable[object]) -> list[str]:
    """Returns names of packages that contain `code` or that the user's modules import; they may not be installed."""
    code = list(code)
    sources = module_sources(code)
    names = {_home(each)[0] for each in code}.union(*(_imported(each.content, each.name) for each in sources))
    modules = {name.partition(".")[0] for name in names} - {each.name.partition(".")[0] for each in sources}
    modules -= {"", "__main__", *sys.stdlib_module_names}
    return packages_of(modules)


def code_hash(code: Iterable[object], known: Iterable[ModuleSource] = ()) -> str:
    """Returns the SHA-256 of the user's modules that contain `code`; empty if there are no such modules.

    Functions and objects that cannot be imported count with everything that they refer to.

    Args:
      known: see `module_sources`.
    """
    code = list(code)
    digest, count = hashlib.sha256(), 0
    for each in code:
        if not isinstance(each, str) and not _by_reference(each):
            with contextlib.suppress(UsageError):  # which is raised when a process needs it
                digest.update(_by_value(each, is_hashed=True))
                count += 1
    for source in module_sources(code, known):
        digest.update(f"{source.name}\0{len(source.content)}\0".encode() + source.content)
        count += 1
    return digest.hexdigest() if count else ""


def edit_remarks(sources: Iterable[ModuleSource]) -> list[str]:
    """Returns a remark on each module whose file differs by now from what this process executes, as in a notebook.

    Processes of a study and of an evaluation execute what was pickled for them, whatever the files hold.
    """
    edited = list[str]()
    for source in sources:
        if _pickled_source(source.path):
            continue
        with contextlib.suppress(OSError):
            if Path(source.path).read_bytes() != source.content:
                edited.append(source.path)
    return [
        f"{clean(path)} was edited after Python had imported it: restart Python to use the new version"
        for path in edited
    ]


def own_copy(code: T) -> T:
    """Returns a copy of an object of the user's, which keeps its own memory from now on.

    Functions, classes, objects of installed packages, and what cannot be copied are returned themselves.
    """
    thing = inspect.unwrap(code) if callable(code) else code
    owner = getattr(thing, "__self__", thing)
    home = type(owner).__module__
    file = str(getattr(sys.modules.get(home), "__file__", None) or "")
    if isinstance(owner, type) or not (home == "__main__" or _is_users(file)):
        return code
    try:
        return copy.deepcopy(code)
    except Exception:
        return code


def memory_warning(code: str, units: str, remedy: str = CODE_REMEDY) -> str:
    """Returns a warning about code, or a policy in a file, that acts differently when the same start is repeated.

    Args:
      code: option and name of the code.
      units: what shares its memory: "episodes".
      remedy: what the user can do.
    """
    return (
        f"{code} acts differently when it is called again at the same start: its memory or random numbers are shared, "
        f"so results depend on the order of {units}; {remedy}"
    )


def _home(code: object) -> tuple[str, str]:
    """Returns the name of the module that holds `code`, and its file if that is known already."""
    if isinstance(code, str):
        place = code.rpartition(":")[0]
        return (Path(place).stem, str(Path(place).resolve())) if place.endswith(".py") else (place, "")
    code = inspect.unwrap(code) if callable(code) else code
    owner = code if inspect.isroutine(code) or isinstance(code, type) else type(code)
    return str(getattr(owner, "__module__", "")), ""


def _file_of(name: str) -> str:
    """Returns the file of a module, also of one that a function will import; empty without one. Imports nothing."""
    if name in sys.modules:
        return str(getattr(sys.modules[name], "__file__", None) or "")
    place, spec = None, None
    for end in [index for index, character in enumerate(name) if character == "."] + [len(name)]:
        spec = importlib.machinery.PathFinder.find_spec(name[:end], place)
        if spec is None:
            return ""
        place = spec.submodule_search_locations or []
    return str(spec.origin or "") if spec else ""


def _is_users(path: str) -> bool:
    return path.endswith(".py") and not path.startswith(_installed())


@cache
def _installed() -> tuple[str, ...]:
    """Returns the folders of the standard library, of installed packages, and of mjrun."""
    paths = sysconfig.get_paths()
    folders = [*(paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")), *site.getsitepackages()]
    return tuple(f"{folder}/" for folder in (*folders, site.getusersitepackages(), Path(__file__).parent))


def _content(name: str, path: str) -> bytes:
    """Returns the source of a module: as this process has executed it, if it was imported by `load_code`."""
    pickled = _pickled_source(path)
    if pickled:
        return pickled.content
    is_loaded = getattr(sys.modules.get(name), "__file__", None) == path
    return _executed[path] if is_loaded and path in _executed else Path(path).read_bytes()


def _pickled_source(path: str) -> ModuleSource | None:
    finders = (each for each in sys.meta_path if isinstance(each, _PickledModules))
    return next((each.by_path[path] for each in finders if path in each.by_path), None)


def _imported(content: bytes, name: str) -> list[str]:
    """Returns the names of the modules that a source imports; of packages, all that lie above them, too."""
    names = set[str]()
    for node in ast.walk(ast.parse(content)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*name.split(".")[: -node.level], *([base] if base else [])])
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    parents = {each.rpartition(".")[0] for each in (*names, name)}
    return [each for each in names | parents if each]


_executed = dict[str, bytes]()  # sources of the user's modules, by the path of the file


class _ModuleReadOnce(importlib.machinery.SourceFileLoader):
    """A loader of a module of the user's, which remembers the source that it executes."""

    def path_stats(self, path: str) -> NoReturn:  # type: ignore[override]
        """Refuses bytecode, which may be of a source that was edited in the same second."""
        raise OSError

    def get_data(self, path: str) -> bytes:  # type: ignore[override]
        content = _executed[path] = super().get_data(path)
        return content


class _ModulesReadOnce(importlib.abc.MetaPathFinder):
    """A finder of the user's modules in files, which Python finds next to each other."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec and type(spec.loader) is importlib.machinery.SourceFileLoader and _is_users(spec.loader.path):
            spec.loader = _ModuleReadOnce(fullname, spec.loader.path)
        return spec


_finder = _ModulesReadOnce()


class _PickledModules(importlib.abc.MetaPathFinder, importlib.abc.SourceLoader):
    """An importer of modules from pickled sources."""

    def __init__(self, sources: Sequence[ModuleSource]) -> None:
        self.by_path = {source.path: source for source in sources}
        self._by_name = {source.name: source for source in sources}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        source = self._by_name.get(fullname)
        return source and importlib.util.spec_from_file_location(fullname, source.path, loader=self)

    def get_filename(self, fullname: str) -> str:
        return self._by_name[fullname].path

    def get_data(self, path: str | bytes) -> bytes:
        return self.by_path[str(path)].content


def load_code(code: str, name: str, form: str) -> object:
    """Loads the target of `code`.

    Args:
      name: the name of the option.
      form: the expected form of such code, for messages.

    Raises:
      UsageError: `code` does not have that form, or its target does not exist.
      FileError: the file does not exist.
      ControllerError: its code failed.
    """
    require_unconfined(f"{option(name)} {quoted(code)} is code")
    place, _, attribute = code.rpartition(":")
    if not place or not attribute:
        raise UsageError(f"{option(name)} {quoted(code)} names no code\n{code_of_file(Path(code)) or form}")
    with same_working_directory():
        return RedirectedFunction(lambda: _load(place, attribute, name, form))()


def code_of_file(path: Path) -> str:
    """Returns how to name each public function and class that a Python file defines; empty if it defines none."""
    if path.suffix != ".py":
        return ""
    try:
        statements = ast.parse(path.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return ""
    defined = [each.name for each in statements if isinstance(each, ast.FunctionDef | ast.ClassDef)]
    return ", ".join(f"{clean(str(path))}:{clean(name)}" for name in defined if not name.startswith("_"))


def made(thing: object, code: str, name: str) -> object:
    """Instantiates `thing` if it is a class; raises ControllerError if that fails."""
    if not isinstance(thing, type):
        return thing
    try:
        with same_working_directory():
            return RedirectedFunction(thing)()
    except (Exception, SystemExit) as error:
        raise ControllerError.of(f"{option(name)} {quoted(code)}", error) from error


def _load(place: str, attribute: str, name: str, form: str) -> object:
    if _finder not in sys.meta_path:
        _installed()  # now, as sysconfig imports a module at its first use
        sys.meta_path.insert(sys.meta_path.index(importlib.machinery.PathFinder), _finder)
    try:
        module = _file(Path(place), form) if place.endswith(".py") else _module(place)
        if not hasattr(module, attribute.partition(".")[0]):
            valid = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
            raise UnknownNameError(name, attribute, valid, where=place, plural="policies" * (name == "policy"))
        return reduce(getattr, attribute.split("."), module)
    except (UsageError, FileError):
        raise
    except (Exception, SystemExit) as error:
        raise ControllerError.of(f"{option(name)} {quoted(f'{place}:{attribute}')}", error) from error


def _file(path: Path, form: str) -> ModuleType:
    known = sys.modules.get(path.stem)
    if known and getattr(known, "__file__", None) == str(path.resolve()):
        return known  # or what it defines could not be pickled
    pickled = _pickled_source(str(path.resolve()))
    if not pickled and not path.is_file():
        raise FileError(path, "there is no such file" if not path.exists() else "is not a file", form)
    sys.path.insert(0, str(path.parent.resolve()))  # as `python FILE.py` does
    loader = _PickledModules([pickled]) if pickled else _ModuleReadOnce(path.stem, str(path.resolve()))
    spec = importlib.util.spec_from_file_location(path.stem, path.resolve(), loader=loader)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses and pickle look there
    spec.loader.exec_module(module)
    return module


def _module(name: str) -> ModuleType:
    sys.path.insert(0, str(Path.cwd()))  # as `python -m` does
    return importlib.import_module(name)
