"""A bake with the exports that its look asks for, in the folder `export` of its own."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

from skinbake.api import open_bake
from skinbake.baking.bake_look import bake_look
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.errors import InputError
from skinbake.export.blender import refuse_varying_f0
from skinbake.export.exports import export_names, write_exports
from skinbake.io.export_list import NAME as LIST
from skinbake.io.export_list import export_figures, is_exported, remove_exports
from skinbake.io.lock import folder_lock
from skinbake.io.manifest import NAME as MANIFEST
from skinbake.io.manifest import read_manifest, write_manifest
from skinbake.irradiance.decide import decide
from skinbake.scene.spec import SceneSpec

FOLDER = "export"


def bake_and_export(
    spec: SceneSpec,
    force: bool = False,
    preview: bool = True,
    verbosity: int = 1,
    session: BakeSession | None = None,
) -> dict[str, Any]:
    """As `bake_look`, then what `output.export` names, also of a bake that missed its tolerance; the manifest.

    Parameters
    ----------
    spec : SceneSpec
    force : bool
        Run every stage and write every export, also those that are there.
    preview : bool
        End with a picture.
    verbosity : int
        0 says nothing, 1 a line a stage, 2 more.
    session : BakeSession, optional
        What this look shares with others.

    Raises
    ------
    InputError, MachineError, ToleranceMissedError
        As `bake_look`; InputError also where a file of others has the name of an export, or the look is such that one
        cannot be made.
    """
    refuse_exports(spec)
    bake_look(spec, force, preview, verbosity, session, partial(_export, spec, force))
    return read_manifest(spec.output.dir)


def refuse_exports(spec: SceneSpec) -> None:
    """Stop before a bake whose exports could not be written.

    Raises
    ------
    InputError
        The look asks for an export that there cannot be of it.
    """
    if "blender" in spec.output.export:
        refuse_varying_f0(spec, decide(spec).energy_conservation.enabled)


def refuse_own_exports(target: Path) -> None:
    """Stop before something is exported to where a bake keeps the exports that its look asks for, and removes others.

    Raises
    ------
    InputError
        `target` is such a folder.
    """
    whole = Path(os.path.realpath(target))  # links that lead in a circle are for whoever writes there
    if whole.name == FOLDER and (whole.parent / MANIFEST).is_file():
        raise InputError(
            f"{target}: expected a folder of its own to export to, got that of the bake's output.export, from which the"
            " next bake removes what its look does not ask for; choose another"
        )


def stale_export(spec: SceneSpec) -> str:
    """Why exports would be written if the bake were to stay as it is; empty where they are there, or none is asked for.

    Raises
    ------
    InputError
        There is no bake, or it is damaged.
    """
    folder = Path(spec.output.dir)
    if not spec.output.export or is_exported(folder / FOLDER, _names(spec, folder), folder):
        return ""
    return f"to write {', '.join(spec.output.export)}"


def _names(spec: SceneSpec, folder: Path) -> list[str]:
    return export_names(open_bake(folder), folder, spec.output.export)


def _export(spec: SceneSpec, force: bool, manifest: dict[str, Any], log: StageLog) -> dict[str, Any]:
    """Write what is asked for and not there; remove what was asked for once, and that of another bake.

    Parameters
    ----------
    spec : SceneSpec
    force : bool
    manifest : mapping
        Of the bake; it comes back with what was exported.
    log : StageLog
    """
    folder = Path(spec.output.dir)
    target, kinds = folder / FOLDER, spec.output.export
    if not kinds and not (target / LIST).is_file():
        return manifest
    with folder_lock(folder, log.say):
        if not kinds:
            remove_exports(target)
            return manifest
        manifest = read_manifest(folder)
        names = _names(spec, folder)
        fresh = not force and is_exported(target, names, folder)
        with log.measured(FOLDER, lambda: fresh):
            if not fresh:
                write_exports(folder, kinds, target)
        files = {name: export_figures(target).get(name, {}) for name in names}
        manifest |= {"export": {"folder": FOLDER, "files": files}}
        write_manifest(folder, manifest)
    return manifest
