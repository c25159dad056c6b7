"""The kinds of export by name, and writing some of them for one bake."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from skinbake.api import BakedSkin, open_bake
from skinbake.baking.verdict import as_typed
from skinbake.errors import InputError
from skinbake.export import blender, gltf, layers, summed, web
from skinbake.io.export_list import finish_export_list, keep_export_list, refuse_foreign
from skinbake.io.lock import folder_lock


class Export(NamedTuple):
    """One kind: the files that it makes of a bake and its folder, and what writes them to a target.

    Writing may give figures by file name.
    """

    names: Callable[[BakedSkin, Path], Sequence[str]]
    write: Callable[[BakedSkin, Path, Path], dict[str, Any] | None]


EXPORTS = {
    "sum": Export(lambda baked, _: summed.sum_names(baked), lambda baked, _, target: summed.write_sum(baked, target)),
    "layers": Export(
        lambda baked, _: layers.layer_names(baked), lambda baked, _, target: layers.write_layers(baked, target)
    ),
    "gltf": Export(lambda *_: [gltf.NAME], lambda baked, _, target: gltf.write_gltf(baked, target)),
    "blender": Export(blender.blender_names, blender.write_blender),
    "web": Export(
        lambda *_: [web.NAME],
        lambda _, folder, target: {web.NAME: {"coding_rms": web.write_web(folder, target)}},
    ),
}


def write_exports(
    folder: Path, kinds: Sequence[str], target: Path, say: Callable[[str], None] = lambda text: None
) -> list[Path]:
    """Write exports of a bake, remove what is left of another bake, and give the paths of what was written.

    Parameters
    ----------
    folder : Path
        Of the bake.
    kinds : sequence of str
        Keys of EXPORTS.
    target : Path
    say : callable
        Told of what was removed.

    Raises
    ------
    InputError
        The bake is missing or damaged, or `target` holds files of others of these names.
    MachineError
        Disk full.
    """
    baked = open_bake(folder)
    if not baked.lights:
        raise InputError(f"{folder}: expected a bake with lights to export, got one for relighting only")
    names = export_names(baked, folder, kinds)
    refuse_foreign(target, names)
    figures: dict[str, Any] = {}
    with folder_lock(target):
        removed, earlier = keep_export_list(target, names, folder)
        if removed:
            say(f"removed {removed} file{'s' * (removed > 1)} of the earlier export of {as_typed(earlier)}")
        for kind in kinds:
            figures |= EXPORTS[kind].write(baked, folder, target) or {}
        finish_export_list(target, names, folder, figures)
    return [target / name for name in names]


def export_names(baked: BakedSkin, folder: Path, kinds: Sequence[str]) -> list[str]:
    """Names of the files that some kinds of export make of a bake.

    Parameters
    ----------
    baked : BakedSkin
    folder : Path
        Of the bake.
    kinds : sequence of str
        Keys of EXPORTS.
    """
    return list(dict.fromkeys(name for kind in kinds for name in EXPORTS[kind].names(baked, folder)))
