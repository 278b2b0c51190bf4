"""
Kernels: inner loops in Python that numba compiles ahead of time, or that run as they stand.

A kernel is a function decorated with `compiled`, for Python to call, or with `compiled_part`,
for other kernels to call. Its annotations are its signature: there is one, and a call with
other types is a TypeError. With the extra ``fast`` installed a kernel runs as machine code,
which `hunt compile` makes for every kernel and keeps on disk; without it, it runs as plain
Python, slower, with the same results to rounding.

Machine code is kept by content: the name of its file holds a hash of all the source it was
made from, of the versions of Python, numba and numpy, and of the processor. A copy, a wheel or
a container finds it; a changed kernel does not.

A process that serves a rig never compiles (`serve_live`).
"""

from __future__ import annotations

import getpass
import hashlib
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, flock
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from subprocess import CalledProcessError, Popen
from types import CodeType, FunctionType, ModuleType
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

_Function = TypeVar('_Function', bound=Callable[..., Any])

# Arrays in the signature of a kernel: their number of dimensions, in C order. `'A'` behind it:
# any strides. A dtype behind it: what void stands for.
F1 = Annotated[NDArray[np.float64], 1]
F2 = Annotated[NDArray[np.float64], 2]
F3 = Annotated[NDArray[np.float64], 3]
C1 = Annotated[NDArray[np.complex128], 1]
I1 = Annotated[NDArray[np.int64], 1]
B1 = Annotated[NDArray[np.bool_], 1]
# ... and one that the kernel only reads, so that it takes an array that nobody may write to.
R1 = Annotated[NDArray[np.float64], 1, 'readonly']

#: Where code for all processors of the last ten years is made, instead of for this one alone.
_COMMON_CPU = 'x86-64-v3'
_COMMON_FEATURES = ('avx2', 'bmi', 'bmi2', 'f16c', 'fma', 'lzcnt', 'movbe')
#: How long all kernels take, s of one core.
_USUAL_S = 80
_PACKAGE = Path(__file__).parent
_NAME = _PACKAGE.name
_TAG = str(sys.implementation.cache_tag)


#: True where kernels run as machine code: numba is there, and nobody has switched it off.
HAVE_COMPILER: bool = find_spec('numba') is not None and os.environ.get(
    'NUMBA_DISABLE_JIT', '0'
) in ('', '0')

#: Every kernel that Python calls, by its full name, once its module is imported.
KERNELS: dict[str, Any] = {}

#: What this process may do with a kernel that is not on disk.
_may_compile = True
_say: Callable[[str], None] = lambda text: None  # noqa: E731


def compiled(function: _Function) -> _Function:
    """
    Make a kernel that Python calls.

    It releases the GIL, and keeps IEEE semantics (no fastmath), so that NaN stays NaN and a
    block split in two gives the same numbers as the whole.

    Parameters
    ----------
    function : callable
        Numeric code without Python objects. Annotations: float, int, bool, `F1` and its like,
        a class of `records`, a NamedTuple or a tuple of these.

    Returns
    -------
    callable
        The kernel, or `function` itself where there is no compiler.
    """
    if not runs_compiled():
        return function
    kernel = _numba().njit(nogil=True)(function)
    kernel._compile_for_args = lambda *values: kernel if _ready(kernel) else function
    KERNELS[f'{function.__module__}.{function.__qualname__}'] = kernel
    return cast(_Function, kernel)


def compiled_part(function: _Function) -> _Function:
    """
    Make a function that kernels call; called from Python it runs as plain Python.

    Parameters
    ----------
    function : callable
        As for `compiled`; what it is called with is its signature.

    Returns
    -------
    callable
        The part, or `function` itself where there is no compiler.
    """
    if not runs_compiled():
        return function
    part = _numba().njit(nogil=True)(function)
    part._compile_for_args = lambda *values: function
    return cast(_Function, part)


def on_compilation(say: Callable[[str], None]) -> None:
    """
    Have it said when a kernel is not on disk, and how far its compilation is.

    Parameters
    ----------
    say : callable
        Gets one line, in the thread that compiles; nothing where all is on disk.
    """
    global _say
    _say = say


def serve_live(say: Callable[[str], None]) -> None:
    """
    Never compile in this process; to be called before any kernel is imported.

    Where machine code is missing, every kernel of this process runs as plain Python.

    Parameters
    ----------
    say : callable
        Gets one line where machine code is missing.
    """
    global _may_compile
    on_compilation(say)
    _may_compile = False


@cache
def runs_compiled() -> bool:
    """Return True if the kernels of this process run as machine code, a live one from disk."""
    if HAVE_COMPILER and not (_may_compile or is_complete()):
        _say('the kernels are not compiled: they run as plain Python, slower (`hunt compile`)')
        return False
    return HAVE_COMPILER


def compile_all() -> int:
    """
    Compile every kernel of the package that is not on disk, on every core.

    Returns
    -------
    int
        How many were compiled; 0 also where machine code can be kept nowhere, which is said.
    """
    if not HAVE_COMPILER or is_complete():
        return 0
    for path in _kernel_files():
        import_module('.'.join(path.relative_to(_PACKAGE.parent).with_suffix('').parts))
    # Others, as those of tests, are no part of the package, and another process has them not.
    ours = {name: one for name, one in KERNELS.items() if name.startswith(f'{_NAME}.')}
    with _only_one():
        files = {name: _file_of(kernel) for name, kernel in ours.items()}
        missing = [name for name, file in files.items() if _find(file) is None]
        try:
            _write(f'all.{_TAG}.none.complete', b'')  # before minutes of work for nothing
        except OSError:
            _say_unkept()
            return 0
        # The largest first: with two at work, it decides how long it takes.
        missing.sort(key=lambda name: -len(_source(KERNELS[name].py_func)))
        if missing:
            _say(f'compiling {len(missing)} kernels, once: about {_USUAL_S} s')
            count = min(os.cpu_count() or 1, len(missing))
            # No pool of processes: each would first run the program that asks once more.
            do = 'import sys; from hunt_ros import compiled; compiled._compile(sys.argv[1:])'
            places = filter(None, [str(_PACKAGE.parent), os.environ.get('PYTHONPATH')])
            env = {**os.environ, 'PYTHONPATH': os.pathsep.join(places)}
            work = [
                Popen([sys.executable, '-c', do, *missing[k::count]], env=env)
                for k in range(count)
            ]
            codes = [process.wait() for process in work]
            if any(codes):
                raise CalledProcessError(1, 'hunt compile')
        complete = f'all.{_TAG}.{_sources()}.complete'
        folder = _write(complete, '\n'.join(files.values()).encode())
        # Of a kernel that is gone, or was another one, a wheel would carry it on; in the cache it
        # may be that of another version.
        for path in folder.glob(f'*.{_TAG}.*') if folder.parent == _PACKAGE else ():
            if path.name not in (complete, *files.values()):
                path.unlink(missing_ok=True)
    return len(missing)


def is_complete() -> bool:
    """Return True if the machine code of every kernel is on disk for this very source."""
    path = _find(f'all.{_TAG}.{_sources()}.complete')
    return path is not None and all(map(_find, path.read_text(encoding='utf-8').split()))


def load() -> None:
    """Load the machine code of every kernel that is imported, so that no first call waits."""
    for kernel in KERNELS.values():
        _ready(kernel)


def _compile(names: list[str]) -> None:
    """Compile kernels, in a process that knows none yet."""
    for name in names:
        import_module(name.rpartition('.')[0])
        _ready(KERNELS[name])


def _ready(kernel: Any) -> bool:
    """
    Give a kernel its machine code, from disk or compiled; it takes no other signature.

    Returns
    -------
    bool
        False where none is on disk, or a damaged one, and this process must not compile.
    """
    function = kernel.py_func
    lock: Any = import_module('numba.core.compiler_lock').global_compiler_lock
    with lock:
        if not kernel._can_compile:
            return True
        if (result := _kept(kernel)) is not None:
            context = kernel.targetctx
            context.insert_user_function(result.entry_point, result.fndesc, [result.library])
            kernel.add_overload(result)
        elif not _may_compile:
            _say_interpreted(function.__qualname__)
            return False
        else:
            _say(f'compiling {function.__name__}, once')
            kernel.compile(signature := _signature(function))
            dumps: Any = import_module('numba.core.serialize').dumps
            try:
                _write(_file_of(kernel), dumps(kernel.overloads[signature]._reduce()))
            except OSError:
                _say_unkept()
        kernel.disable_compile()
    return True


def _kept(kernel: Any) -> Any:
    """Return the machine code of a kernel on disk, or None where it is not there or damaged."""
    if path := _find(_file_of(kernel)):
        rebuild: Any = import_module('numba.core.compiler').CompileResult._rebuild
        kernel.targetctx.refresh()
        try:
            return rebuild(kernel.targetctx, *pickle.loads(path.read_bytes()))
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            with suppress(OSError):
                path.unlink()
    return None


def _file_of(kernel: Any) -> str:
    """Return the name of its file, which changes with anything that the code hangs on."""
    function = kernel.py_func
    parts = (_source(function), repr(_signature(function)), _build())
    stamp = hashlib.sha256('\n'.join(parts).encode()).hexdigest()[:24]
    return f'{function.__module__}.{function.__qualname__}.{_TAG}.{stamp}.code'


@cache
def _say_interpreted(name: str) -> None:
    _say(f'{name} is not compiled: it runs as plain Python (`hunt compile` compiles it)')


@cache
def _say_unkept() -> None:
    print(
        f'{_NAME}: machine code cannot be kept in any of {", ".join(map(str, _folders()))}: it is'
        ' made at every start (NUMBA_CACHE_DIR names another place)',
        file=sys.stderr,
    )


def _folders() -> list[Path]:
    """Return where machine code is looked for, the first that can be written keeps new one."""
    own = os.environ.get('NUMBA_CACHE_DIR')
    home = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    beside = [_PACKAGE / 'machine_code', Path(home) / _NAME]
    return [Path(own) / _NAME, *beside] if own else beside


def _find(name: str) -> Path | None:
    return next((path for folder in _folders() if (path := folder / name).exists()), None)


def _write(name: str, content: bytes) -> Path:
    """Keep a file whole, in the first folder that takes it; return that."""
    for folder in _folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            handle, part = tempfile.mkstemp(prefix='.', dir=folder)
            with open(handle, 'wb') as file:
                file.write(content)
            os.replace(part, folder / name)
            return folder
        except OSError:
            continue
    raise OSError(f'nothing can be written in {", ".join(map(str, _folders()))}')


@contextmanager
def _only_one() -> Iterator[None]:
    """Wait until no other process compiles."""
    with open(Path(tempfile.gettempdir()) / f'{_NAME}-compile-{getpass.getuser()}', 'wb') as file:
        flock(file, LOCK_EX)
        yield


def _kernel_files() -> list[Path]:
    """Return the modules that have kernels or parts of them."""
    return [p for p in sorted(_PACKAGE.rglob('*.py')) if b'\n@compiled' in p.read_bytes()]


@cache
def _sources() -> str:
    """Return a hash of all modules that kernels are made from."""
    stamp = hashlib.sha256(_build().encode())
    for path in (*_kernel_files(), Path(__file__), _PACKAGE / 'records.py'):
        stamp.update(path.read_bytes())
    return stamp.hexdigest()[:24]


@cache
def _build() -> str:
    """Return what else machine code hangs on: interpreter, libraries, processor."""
    llvm: Any = import_module('llvmlite.binding')
    cpu = os.environ.get('NUMBA_CPU_NAME') or _common_cpu() or llvm.get_host_cpu_name()
    features = os.environ.get('NUMBA_CPU_FEATURES', '')
    versions = [version(name) for name in ('numba', 'llvmlite', 'numpy')]
    return ' '.join(
        [sys.implementation.cache_tag, llvm.get_process_triple(), cpu, features, *versions]
    )


@cache
def _common_cpu() -> str:
    """Return the name of the common kind of processor that this one is of, '' for none."""
    features = import_module('llvmlite.binding').get_host_cpu_features()
    return _COMMON_CPU if all(features.get(name) for name in _COMMON_FEATURES) else ''


@cache
def _numba() -> Any:
    """Import the compiler where a kernel needs it: it takes half a second."""
    if 'NUMBA_CPU_NAME' not in os.environ and _common_cpu():
        # Code for the common processor is the same on every machine, and can be shipped. Numba
        # asks for its name at the first kernel; other kernels of this process get it too.
        config: Any = import_module('numba.core.config')
        config.CPU_NAME, config.CPU_FEATURES = _common_cpu(), ''
    import numba

    return numba


@cache
def _signature(function: FunctionType) -> tuple[Any, ...]:
    """Return numba's types of the parameters of a kernel."""
    hints = get_type_hints(function, include_extras=True)
    hints.pop('return', None)
    return tuple(_type(hint, f'{function.__qualname__}({name})') for name, hint in hints.items())


def _type(hint: Any, where: str) -> Any:
    """Return numba's type of an annotation."""
    from hunt_ros.records import dtype_of

    numba = _numba()
    types, from_dtype = numba.types, numba.from_dtype

    if hint in (float, int, bool):
        return {float: types.float64, int: types.int64, bool: types.boolean}[hint]
    if get_origin(hint) is Annotated:
        array, dimensions, *more = get_args(hint)
        dtype = next((m for m in more if isinstance(m, np.dtype)), None)
        dtype = dtype or np.dtype(get_args(get_args(array)[1])[0])
        return types.Array(
            from_dtype(dtype),
            dimensions,
            'A' if 'A' in more else 'C',
            readonly='readonly' in more,
            aligned=dtype.names is None or dtype.isalignedstruct,
        )
    if get_origin(hint) is tuple:
        return types.BaseTuple.from_types([_type(inner, where) for inner in get_args(hint)])
    if isinstance(hint, type) and issubclass(hint, tuple):
        fields = get_type_hints(hint, include_extras=True)
        inner = [_type(hint, where) for hint in fields.values()]
        return types.BaseTuple.from_types(inner, hint)
    if isinstance(hint, type) and not issubclass(hint, np.generic | np.ndarray):
        return from_dtype(dtype_of(hint))
    raise TypeError(f'{where}: {hint} is no type of a kernel: expected float, int, bool, F1, ...')


@cache
def _source(function: FunctionType) -> str:
    """Return all that a kernel is made from: its code, its parts' and the constants they name."""
    seen: dict[str, str] = {}
    waiting = [function]
    while waiting:
        one = waiting.pop()
        name = f'{one.__module__}.{one.__qualname__}'
        if name in seen:
            continue
        code = one.__code__
        if any(isinstance(const, CodeType) for const in code.co_consts):
            raise TypeError(f'{name}: a function within a kernel, expected none')
        lines = [name, f'{code.co_code.hex()} {code.co_names} {list(code.co_consts)}']
        for used in code.co_names:
            value = one.__globals__.get(used)
            value = getattr(value, 'py_func', value)
            if isinstance(value, FunctionType):
                if value.__module__.partition('.')[0] not in ('numba', 'numpy'):
                    waiting.append(value)
            elif isinstance(value, ModuleType):
                if value.__name__.startswith(_NAME):
                    lines.append(Path(str(value.__file__)).read_text(encoding='utf-8'))
            elif isinstance(value, np.ndarray):
                lines.append(f'{used} {value.dtype} {value.shape} {value.tobytes().hex()}')
            elif isinstance(value, type):
                lines.append(f'{used} {getattr(value, "_fields", value.__name__)}')
            elif value is not None:
                lines.append(f'{used} {value!r}')
        seen[name] = '\n'.join(lines)
    return '\n'.join(seen[name] for name in sorted(seen))
