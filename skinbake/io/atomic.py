"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from skinbake.errors import InputError, MachineError
from skinbake.interrupt import remove_tree, undone_at_stop

LONG = 200  # bytes of a name; no more than 255 are allowed, with what is added here and by libraries
# ... the second part is what OpenImageIO's texture maker adds to the name that it was given
_TEMPORARY = re.compile(r"\..+\.\d+\.part(\.\w+)?(\.[0-9a-f]{8}\.temp\.\w+)?")


@contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Give a path beside `path` to write to; on success fsync it and rename it over `path`, else remove it.

    The temporary name keeps the suffix, since writers choose the format by it.

    Raises
    ------
    MachineError
        Disk full.
    InputError
        The folder cannot be written to.
    """
    path = Path(path)
    stem = path.stem if len(os.fsencode(path.name)) <= LONG else hashlib.sha256(os.fsencode(path.name)).hexdigest()
    temporary = path.with_name(f".{stem}.{os.getpid()}.part{path.suffix}")
    try:
        with explained(path), undone_at_stop(partial(os.unlink, temporary)):
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.unlink(missing_ok=True)  # a link that somebody put there would lead elsewhere
            yield temporary
            with open(temporary, "rb+") as file:
                os.fsync(file.fileno())
            os.replace(temporary, path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def temporary_folder() -> Iterator[str]:
    """Give a new folder in the system's place for temporary files; it is removed with what is in it."""
    with TemporaryDirectory(prefix="skinbake-") as folder, undone_at_stop(partial(remove_tree, folder)):
        yield folder


def temporary_files(folder: Path) -> list[Path]:
    """What `atomic_write` names its files in `folder` until they are whole: left behind by writers that were killed."""
    return [path for path in folder.glob(".*.part*") if _TEMPORARY.fullmatch(path.name)]


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn the system's errors about `path` into messages that say what to do.

    Raises
    ------
    MachineError
        Disk full, file too large, or what a library says.
    InputError
        The folder cannot be written to, or a file is in its place.
    """
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise MachineError(
                f"{path}: the disk is full; free some space and run again, finished stages are kept"
            ) from error
        if error.errno == errno.EFBIG:
            raise MachineError(
                f"{path}: the file is larger than the disk's format or `ulimit -f` allows; choose another --out,"
                " or a smaller texture.size"
            ) from error
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise InputError(
                f"{path}: expected a folder that can be written to ({error.strerror}); choose another --out"
            ) from error
        if error.errno in (errno.ENOTDIR, errno.EEXIST, errno.EISDIR):
            raise InputError(f"{path}: expected a folder, got a file in the way ({error.strerror})") from error
        if error.errno == errno.ELOOP and not path.is_symlink():
            raise InputError(
                f"{path}: expected a folder, got links that lead in a circle ({error.strerror})"
            ) from error
        if error.errno == errno.EIO:  # a failing disk, or a library's word
            raise MachineError(f"{path}: cannot be written ({error.strerror or error})") from error
        raise


def system_error(temporary: Path, said: str) -> OSError:
    """Error of the system behind a library's complaint that it could not write a file.

    Parameters
    ----------
    temporary : Path
        As `atomic_write` gave it.
    said : str
        The library's message.
    """
    try:
        with open(temporary, "ab"):
            pass
    except OSError as error:
        return error
    for code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        if os.strerror(code) in said:
            return OSError(code, said)
    said, *_ = said.splitlines() or [""]
    largest = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if temporary.exists() and temporary.stat().st_size == largest:  # some libraries do not say why they stopped there
        return OSError(errno.EFBIG, said)
    full = shutil.disk_usage(temporary.parent).free < 1 << 16
    return OSError(errno.ENOSPC if full else errno.EIO, said or os.strerror(errno.EIO))


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write bytes atomically."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path | str, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
