"""A chart layout by xatlas, which lets no other Python thread run while it works: a large mesh has its own process.

That process can be ended at any moment, as Ctrl-C asks; the library could not.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import MachineError
from skinbake.interrupt import undone_at_stop
from skinbake.io.waiting import Tick

SMALL_FACES = 2000  # takes less time than starting a process
TICK_S = 0.5
Layout = tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.float32]]


def xatlas_layout(
    positions: NDArray[np.float32], faces: NDArray[np.uint32], padding: int, tick: Tick = lambda: None
) -> Layout:
    """Charts of a mesh packed into [0, 1]^2.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), uint32
    padding : int
        Texels between charts, of a texture of 1024.
    tick : callable
        Called now and then while another process works.

    Returns
    -------
    vertex : ndarray of shape (C,)
        Vertex of each corner of the layout.
    corner : ndarray of shape (F, 3)
        Corners of each face.
    uv : ndarray of shape (C, 2)

    Raises
    ------
    MachineError
        The process that did it has died.
    """
    if len(faces) <= SMALL_FACES:
        return _generate(positions, faces, padding)
    package = str(Path(__file__).parents[3])
    path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-c", f"from {__name__} import serve; serve()"]
    # Given as a file, not through a pipe: of what a full pipe had not taken at a timeout, `communicate` sends nothing
    with (
        TemporaryFile() as given,
        subprocess.Popen(
            command,
            stdin=_filled(given, positions, faces, padding),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": path},
        ) as process,
        undone_at_stop(process.kill),
    ):
        made = _answer(process, tick)
    if process.returncode:
        raise MachineError(
            f"texture.unwrap: xatlas ended with exit code {process.returncode} (out of memory?); "
            "a mesh of fewer triangles needs less"
        )
    with np.load(BytesIO(made)) as arrays:
        return arrays["vertex"], arrays["corner"], arrays["uv"]


def _filled(file: IO[bytes], positions: NDArray[np.float32], faces: NDArray[np.uint32], padding: int) -> IO[bytes]:
    """A file that holds what is to be laid out, to be read from its start."""
    np.savez(file, positions=positions, faces=faces, padding=padding)
    file.seek(0)
    return file


def _answer(process: subprocess.Popen[bytes], tick: Tick) -> bytes:
    """What the process writes."""
    while True:
        try:
            return process.communicate(timeout=TICK_S)[0]
        except subprocess.TimeoutExpired:
            tick()


def _generate(positions: NDArray[np.float32], faces: NDArray[np.uint32], padding: int) -> Layout:
    """Have xatlas make the layout, in this process."""
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(positions, faces)
    charts, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    packing.padding = padding
    packing.resolution = 1024
    packing.bilinear = True
    atlas.generate(charts, packing)
    vertex, corner, uv = atlas[0]
    return vertex, corner, uv


def serve() -> None:
    """Read a mesh from stdin, write its layout to stdout: what the other process does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent hears of it and ends us
    with np.load(BytesIO(sys.stdin.buffer.read())) as given:
        vertex, corner, uv = _generate(given["positions"], given["faces"], int(given["padding"]))
    made = BytesIO()
    np.savez(made, vertex=vertex, corner=corner, uv=uv)
    sys.stdout.buffer.write(made.getvalue())
