"""Compiles kernels with numba and keeps their machine code on the disk, for every process and copy of the project.

An entry is named after what decides its machine code: the bytecode of the kernel and of every function of ours that it
may call or inline, the values of the globals they read, the types of the arguments, the options, the processor and the
versions of Python and the compilers. Names of files, their times and line numbers are not among them, nor are
docstrings and comments: an edited docstring compiles nothing, an edited kernel compiles itself and whoever uses it.
"""

from __future__ import annotations

import builtins
import contextlib
import dis
import enum
import gc
import hashlib
import inspect
import logging
import os
import pickle
import platform
import stat
import sys
import tempfile
import time
import types as python_types
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import config, event
from numba.core.caching import _Cache
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.extending import is_jitted

from skinbake.interrupt import undone_at_stop
from skinbake.kernels.stored_code import runnable
from skinbake.kernels.watch_compiling import tell_watchers
from skinbake.machine import require_memory

_KEPT_DAYS = 30
_ROOM_BYTES = 48 * 2**20  # that loading or compiling a kernel finds free: without, LLVM ends the process
_LOG = logging.getLogger(__name__)
_LOADS_CONSTANT = frozenset(dis.hasconst)
_SWITCHES = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK")  # of the environment: NUMBA_OPT ...
_VERSIONS = (
    platform.python_implementation(),
    sys.version_info[:3],
    numba.__version__,
    llvmlite.__version__,
    np.__version__,
)


def kernel(function: Callable[..., Any] | None = None, *, inline: bool = False, inner: bool = False) -> Any:
    """Have numba compile a function, its machine code kept on the disk; it runs without the interpreter's lock.

    Loops over threads are `skinbake.kernels.threads`' task: numba's own cost three times the compiling.

    Parameters
    ----------
    function : callable
        What to compile; left out where the decorator has options.
    inline : bool
        Whether callers take in the body before types are inferred, instead of calling it.
    inner : bool
        Called by other kernels alone: no entry for Python, whose unpacking of arguments has to be compiled too.
    """
    if function is None:
        return lambda function: kernel(function, inline=inline, inner=inner)
    options: dict[str, Any] = {
        "inline": "always" if inline else "never",
        "no_cpython_wrapper": inner,
        "no_cfunc_wrapper": True,  # nobody calls kernels from C
        "error_model": "numpy",  # as arrays divide: without a way out by an exception behind each division
    }
    compiled: Any = numba.njit(nogil=True, **options)(function)
    if _is_kernel(compiled):  # numba leaves functions as they are under NUMBA_DISABLE_JIT
        compiled._cache = _KernelCache(compiled)
    return compiled


def fingerprint(compiled: Any) -> str:
    """Digest of all code and constants that decide a kernel's machine code; hexadecimal.

    Raises
    ------
    TypeError
        A global that the kernel reads is of a kind whose content is not understood.
    """
    ours = _ours(compiled.py_func)
    digest = hashlib.sha256()
    met: dict[int, Any] = {id(compiled): compiled}
    queue = [compiled]
    for value in queue:  # grows while it is walked
        text, needs = _described(value, ours)
        digest.update(text.encode() + b"\0")
        for need in needs:
            if id(need) not in met:
                met[id(need)] = need
                queue.append(need)
    return digest.hexdigest()


def _is_kernel(value: Any) -> bool:
    return bool(is_jitted(value))


def _package(module: str) -> str:
    return module.partition(".")[0]


def _ours(function: Any) -> frozenset[str]:
    """Packages whose functions are looked into; those of all others have the versions of their packages."""
    return frozenset((_package(function.__module__), _package(__name__)))


def _described(value: Any, ours: frozenset[str]) -> tuple[str, list[Any]]:
    """What a kernel, a function or a module of ours says by itself, and those that it needs."""
    if isinstance(value, python_types.ModuleType):
        return repr(_canonical(_module_code(value))), []
    options = sorted(value.targetoptions.items()) if _is_kernel(value) else ()
    function = value.py_func if _is_kernel(value) else value
    needs: list[Any] = []
    seen = [(name, _stated(read, ours, needs)) for name, read in _read_by(function)]
    defaults = _stated((function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items()))), ours, needs)
    return repr((function.__qualname__, options, _canonical(function.__code__), defaults, seen)), needs


def _canonical(code: python_types.CodeType) -> Any:
    """All of a code object but its docstring, annotations' places, file and line numbers.

    A docstring is a constant that no instruction loads, so constants stand where they are loaded.
    """
    raw = bytearray(code.co_code)
    constants = []
    extended = 0
    for at in range(0, len(raw), 2):
        operation, argument = raw[at], raw[at + 1] | extended
        extended = argument << 8 if operation == dis.EXTENDED_ARG else 0
        if operation in _LOADS_CONSTANT:
            constant = code.co_consts[argument]
            nested = isinstance(constant, python_types.CodeType)
            constants.append(_canonical(constant) if nested else (type(constant).__name__, repr(constant)))
            raw[at + 1] = 0
    return (
        bytes(raw),
        code.co_exceptiontable,
        constants,
        code.co_names,
        code.co_varnames,
        code.co_freevars,
        code.co_cellvars,
        (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags),
    )


def _read_by(function: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of the globals and of the enclosing function's variables that a function may read."""
    codes = [function.__code__]
    for code in codes:  # grows while it is walked: functions within
        codes += [constant for constant in code.co_consts if isinstance(constant, python_types.CodeType)]
        for name in code.co_names:
            if name in function.__globals__:
                yield name, function.__globals__[name]
            elif hasattr(builtins, name):
                yield name, getattr(builtins, name)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _stated(value: Any, ours: frozenset[str], needs: list[Any]) -> Any:
    """A value in words that change with its content; functions and modules of ours are added to `needs`."""
    if _is_kernel(value) or inspect.isfunction(value):
        if _package(value.__module__) in ours:
            needs.append(value)
        return (value.__module__, value.__qualname__)
    if isinstance(value, numba.core.extending._Intrinsic):
        # What it makes depends on overloads and types of its whole module, which no name leads to
        needs.append(sys.modules[value._defn.__module__])
        return value._name
    if isinstance(value, python_types.ModuleType):
        if _package(value.__name__) in ours:
            needs.append(value)
        return value.__name__
    if isinstance(value, (tuple, frozenset)) and type(value) in (tuple, frozenset):
        inside = [_stated(each, ours, needs) for each in value]
        return (type(value).__name__, inside if isinstance(value, tuple) else sorted(map(repr, inside)))
    if isinstance(value, enum.Enum) or value is None or isinstance(value, (bool, int, float, complex, str, bytes)):
        return (type(value).__name__, repr(value))
    if isinstance(value, np.generic):
        return (value.dtype.str, value.tobytes())
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return (value.dtype.str, value.shape, value.strides, value.tobytes())
    if isinstance(value, tuple):  # a named one
        return (_stated(type(value), ours, needs), [_stated(each, ours, needs) for each in value])
    if isinstance(value, type):
        return (value.__module__, value.__qualname__, getattr(value, "_fields", ()))
    if isinstance(value, types.Type):
        return _type_text(value, ours, needs)
    if isinstance(value, (np.dtype, np.ufunc)):
        return str(value)
    if callable(value) and getattr(value, "__name__", None):
        return (str(getattr(value, "__module__", "")), value.__name__)
    raise TypeError(f"a kernel cannot read a global of type {type(value).__name__}: {value!r}")


def _type_text(of: Any, ours: frozenset[str], needs: list[Any]) -> str:
    """Numba's name of a type, with the fields of named tuples, which that leaves out."""
    if hasattr(of, "types"):  # tuples
        inside = [_type_text(each, ours, needs) for each in of.types]
        return f"{_stated(getattr(of, 'instance_class', None), ours, needs)}({', '.join(inside)})"
    if isinstance(of, types.Optional):
        return f"Optional({_type_text(of.type, ours, needs)})"
    if isinstance(of, types.Dispatcher):
        return fingerprint(of.dispatcher)
    return str(of)


def _module_code(module: python_types.ModuleType) -> Any:
    """A module's code without docstrings."""
    source = inspect.getsource(module)
    return compile(source, "", "exec", dont_inherit=True, optimize=2)


def cache_folders() -> tuple[Path, ...]:
    """Where machine code is looked for, in this order; new code goes to the last, if there is any.

    NUMBA_CACHE_DIR, else the user's folder for caches; where that cannot be written, one of this user's in the folder
    for temporary files as well.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen:
        home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        # A relative name would be another folder in every working directory
        chosen = os.path.join(home, "skinbake", "kernels") if os.path.isabs(home) else None
    found = []
    if chosen:
        with contextlib.suppress(OSError):
            os.makedirs(chosen, exist_ok=True)
        if os.access(chosen, os.R_OK | os.X_OK):
            found.append(Path(chosen))
        if os.access(chosen, os.W_OK | os.X_OK):
            return tuple(found)
    temporary = Path(tempfile.gettempdir(), f"skinbake-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}")
    with contextlib.suppress(OSError):
        temporary.mkdir(mode=0o700, exist_ok=True)
        # Machine code that another user could have put there is not run
        mine = os.lstat(temporary)
        if stat.S_ISDIR(mine.st_mode) and mine.st_uid == os.getuid() and not mine.st_mode & 0o022:
            found.append(temporary)
    return tuple(found)


class _Compiling(event.Listener):
    """Tells of kernels that are compiled, and has the collector of cycles rest meanwhile.

    That one looks, in vain, through all that a compiler remembers: a tenth of the time. Compiling is behind numba's
    lock, so that one thread at a time is counted here; what a kernel calls is compiled inside it.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._told = self._collect = False

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth > 1:
            return
        self._collect = gc.isenabled()
        gc.disable()
        if not self._told:
            _LOG.info("compiling kernels, once ...")
            self._told = True
        tell_watchers(_name(event.data["dispatcher"]), True)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth:
            return
        if self._collect:
            gc.enable()
        name = _name(event.data["dispatcher"])
        _LOG.debug("compiled %s", name)
        tell_watchers(name, False)


def _name(compiled: Dispatcher) -> str:
    """Module and name of a kernel."""
    return f"{compiled.py_func.__module__}.{compiled.py_func.__qualname__}"


event.register("numba:compile", _Compiling())


class _KernelCache(_Cache):
    """Machine code of one kernel on the disk: one file for each combination of argument types."""

    def __init__(self, compiled: Dispatcher) -> None:
        self._compiled = compiled
        self._fingerprint: str | None = None
        self._enabled = True

    @property
    def cache_path(self) -> str | None:
        folders = cache_folders()
        return str(folders[-1]) if folders else None

    def enable(self) -> None:
        self._enabled = True

    def disable(self) -> None:
        self._enabled = False

    def flush(self) -> None:
        """Nothing to do: an entry of changed code has another name."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel for these types of arguments, or None: a missing or damaged entry.

        Raises
        ------
        MachineError
            A limit leaves no room for it, nor for its compilation.
        """
        require_memory(_ROOM_BYTES, "loading of kernels")
        if not self._enabled:
            return None
        name = self._entry(sig, target_context.codegen())
        for folder in cache_folders():
            data = _read(folder / name)
            if data is not None:
                # An entry that is whole and yet does not load names something that is gone: compiled anew
                with contextlib.suppress(Exception):
                    return runnable(target_context, pickle.loads(data))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel; a disk that refuses costs another compilation and nothing else."""
        if not self._enabled or any(not part.can_cache for part in data.lifted) or data.library.has_dynamic_globals:
            return
        folders = cache_folders()
        if folders:
            # The types of every variable, in words, are half of what numba would write, and nobody asks for them
            content = dumps(data._replace(type_annotation="")._reduce())
            with contextlib.suppress(OSError):
                _write(folders[-1] / self._entry(sig, data.codegen), content)

    def _entry(self, sig: Any, codegen: Any) -> str:
        """File name of the entry for these types of arguments on this machine."""
        if self._fingerprint is None:
            self._fingerprint = fingerprint(self._compiled)
        function = self._compiled.py_func
        arguments = sig if isinstance(sig, tuple) else (*sig.args, sig.return_type)
        needs: list[Any] = []
        text = [_type_text(of, _ours(function), needs) for of in arguments]
        switches = [getattr(config, name) for name in _SWITCHES]
        everything = (self._fingerprint, function.__module__, text, codegen.magic_tuple(), repr(switches), _VERSIONS)
        digest = hashlib.sha256(repr(everything).encode()).hexdigest()[:32]
        return f"{function.__module__}.{function.__qualname__}-{digest}".replace("<", "").replace(">", "")


def _read(path: Path) -> bytes | None:
    """What `_write` wrote; None where nothing or something else is found."""
    try:
        content = path.read_bytes()
        if time.time() - path.stat().st_mtime > 86400:
            os.utime(path)  # in use: not to be swept
    except OSError:
        return None
    return content[32:] if hashlib.sha256(content[32:]).digest() == content[:32] else None


_swept: set[Path] = set()


def _write(path: Path, data: bytes) -> None:
    """Put an entry in place at once; the first in a folder removes what nobody has used for a month.

    Raises
    ------
    OSError
        The folder or the disk refuses.
    """
    handle, part = tempfile.mkstemp(dir=path.parent, prefix=".part-")
    try:
        with undone_at_stop(partial(os.unlink, part)):
            with os.fdopen(handle, "wb") as stream:
                stream.write(hashlib.sha256(data).digest() + data)
            os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise
    if path.parent not in _swept:
        _swept.add(path.parent)
        with os.scandir(path.parent) as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    age = (time.time() - entry.stat().st_mtime) / 86400
                    if age > (1 if entry.name.startswith(".part-") else _KEPT_DAYS) and entry.is_file():
                        os.unlink(entry)
