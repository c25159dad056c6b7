"""`skinbake export FOLDER --to DIR`: a bake as files that other programs read."""

from __future__ import annotations

from pathlib import Path

import click

from skinbake.cli.options import Output, bake_folder, quiet_option


@click.command("export")
@click.argument("folder", type=click.Path())
@click.option("--to", type=Output(), required=True, help="Folder to write to; made where there is none.")
@click.option("--sum", "summed", is_flag=True, help="sum.exr and sum.png: the light that leaves the skin, added up.")
@click.option("--layers", is_flag=True, help="Each texture as an EXR of one part, channels R G B.")
@click.option("--gltf", is_flag=True, help="skin.glb: the head with its light, for any viewer.")
@click.option("--web", is_flag=True, help="head.html: one page that shows the bake in any browser, no network.")
@quiet_option
def command(folder: str, to: str, summed: bool, layers: bool, gltf: bool, web: bool, verbosity: int) -> None:
    """Write what the bake in FOLDER, or of the look FOLDER.yaml, holds in forms that need no skinbake.

    The bake is only read. Exports of one bake may be added to one another; those of another bake are replaced, and
    what is left of it is removed. A file that no export has made is never touched.
    """
    from skinbake.api import open_bake
    from skinbake.errors import InputError, printable
    from skinbake.export.gltf import NAME, write_gltf
    from skinbake.export.layers import layer_names, write_layers
    from skinbake.export.summed import sum_names, write_sum
    from skinbake.export.web import NAME as PAGE
    from skinbake.export.web import write_web
    from skinbake.io.export_list import keep_export_list, refuse_foreign
    from skinbake.io.manifest import NAME as MANIFEST

    if not (summed or layers or gltf or web):
        raise InputError("export: expected one or more of --sum, --layers, --gltf and --web, got none")
    folder = bake_folder(folder)
    folder = str(Path(folder).parent) if Path(folder).name == MANIFEST else folder
    if not Path(folder).is_dir():
        raise InputError(
            f"{folder}: expected a bake folder, found none; `skinbake bake CONFIG --out {folder}` makes one"
        )
    frames = sorted(path.parent.name for path in Path(folder).glob(f"*/{MANIFEST}"))
    if frames and not (Path(folder) / MANIFEST).is_file():
        raise InputError(f"{folder}: expected one bake, got several: {', '.join(frames[:5])} ...; name one")
    baked, target = open_bake(folder), Path(to)
    names = [*(sum_names(baked) if summed else ()), *(layer_names(baked) if layers else ()), *([NAME] if gltf else ())]
    names += [PAGE] if web else []
    refuse_foreign(target, names)
    keep_export_list(target, names, Path(folder))
    if summed:
        write_sum(baked, target)
    if layers:
        write_layers(baked, target)
    if gltf:
        write_gltf(baked, target)
    if web:
        write_web(Path(folder), target)
    if verbosity:
        print(printable("\n".join(str(target / name) for name in names)))
