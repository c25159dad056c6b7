"""Names of the files in a bake folder, and which of them are ours to remove."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from skinbake.errors import InputError
from skinbake.io.atomic import write_text
from skinbake.io.manifest import NAME, read_manifest
from skinbake.io.output_names import MESH, is_output, refuse_foreign
from skinbake.scene.spec import SceneSpec

UNFINISHED = ".bake.files"


class FolderFiles:
    """Files that bakes have left in a folder.

    The manifest lists them. While a bake is at work there is none, and `.bake.files` lists what the last one left and
    what this one has begun to write, so that a bake that was killed leaves nothing that nobody knows of. What is in
    neither is somebody else's and stays.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.sizes: dict[str, int] = {}
        self.names: set[str] = set()

    def read(self) -> dict[str, Any]:
        """Learn what is there; gives the manifest, or nothing where there is none or a damaged one."""
        try:
            manifest = read_manifest(self.folder)
        except InputError:
            manifest = {}
        self.sizes = dict(manifest.get("bytes", {}))
        self.names = {name for name in (*self.sizes, *_unfinished(self.folder)) if is_output(name)}
        return manifest

    def refuse_foreign(self, unless: Iterable[str] = ()) -> None:
        """Stop before somebody else's file is written over: one of a name that bakes write to.

        Parameters
        ----------
        unless : iterable of str
            Names that will not be written to.

        Raises
        ------
        InputError
            A file is there that neither the manifest lists nor its own header proves to be ours.
        """
        there = {path.name for path in self.folder.iterdir() if is_output(path.name)}
        refuse_foreign(self.folder / name for name in sorted(there - self.names - set(unless)))

    def as_left(self, path: Path) -> bool:
        """Whether a file has the size it was left with: a copy may have been cut short since."""
        size = path.stat().st_size
        return self.sizes.get(path.name, size) == size

    def begin(self, names: Iterable[str]) -> None:
        """Say which files will be written; from now on there is no manifest."""
        names = set(names)
        refuse_foreign(self.folder / name for name in sorted(names - self.names))
        self.names |= names
        write_text(self.folder / UNFINISHED, json.dumps(sorted(self.names)) + "\n")
        (self.folder / NAME).unlink(missing_ok=True)

    def finish(self) -> None:
        """The manifest lists everything now."""
        (self.folder / UNFINISHED).unlink(missing_ok=True)

    def remove(self, names: Iterable[str]) -> None:
        """Remove files, of which only those that are ours."""
        for name in sorted(self.names & set(names)):
            (self.folder / name).unlink(missing_ok=True)
            self.names.discard(name)
            self.sizes.pop(name, None)


def refuse_inputs_as_outputs(spec: SceneSpec, folder: Path, inputs: Iterable[Path]) -> None:
    """Stop before a bake would write over a file that its look reads.

    Parameters
    ----------
    spec : SceneSpec
    folder : Path
        Where it bakes into.
    inputs : iterable of Path
        Every file of the look.

    Raises
    ------
    InputError
        A file of the look lies in `folder` under a name that the bake writes.
    """
    for path in inputs:
        if path.name == MESH and spec.texture.unwrap == "none":
            continue
        if is_output(path.name) and path.parent.exists() and folder.exists() and path.parent.samefile(folder):
            raise InputError(
                f"{path}: expected inputs that the bake does not write, got one of its output names in {folder}; "
                "choose another output.dir, or --out"
            )


def _unfinished(folder: Path) -> list[str]:
    try:
        names = json.loads((folder / UNFINISHED).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return []
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
