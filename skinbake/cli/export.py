"""`skinbake export FOLDER --to DIR`: a bake as files that other programs read."""

from __future__ import annotations

from pathlib import Path

import click

from skinbake.cli.options import Output, changed_since, named_look, quiet_option


@click.command("export")
@click.argument("folder", type=click.Path())
@click.option("--to", type=Output(file_okay=False), required=True, help="Folder to write to; made where there is none.")
@click.option("--sum", is_flag=True, help="sum.exr and sum.png: the light that leaves the skin, added up.")
@click.option("--layers", is_flag=True, help="Each texture as an EXR of one part, channels R G B.")
@click.option("--gltf", is_flag=True, help="skin.glb: the head with its light, for any viewer.")
@click.option("--blender", is_flag=True, help="skin_blender.py: builds the head in Blender; with mesh and --layers.")
@click.option("--web", is_flag=True, help="head.html: one page that shows the bake in any browser, no network.")
@quiet_option
def command(folder: str, to: str, verbosity: int, **kinds: bool) -> None:
    """Write what the bake in FOLDER, or of the look FOLDER.yaml, holds in forms that need no skinbake.

    The bake is only read. Exports of one bake may be added to one another; those of another bake are replaced, and
    what is left of it is removed. A file that no export has made is never touched.
    """
    from skinbake.errors import InputError, printable
    from skinbake.export.after_bake import refuse_own_exports
    from skinbake.export.exports import write_exports
    from skinbake.io.manifest import NAME as MANIFEST
    from skinbake.progress import Progress

    wanted = [kind for kind in kinds if kinds[kind]]
    if not wanted:
        *some, last = (f"--{kind}" for kind in kinds)
        raise InputError(f"export: expected one or more of {', '.join(some)} and {last}, got none")
    named, look = folder, named_look(folder)
    folder = look.output.dir if look else folder
    folder = str(Path(folder).parent) if Path(folder).name == MANIFEST else folder
    if not Path(folder).is_dir():
        raise InputError(
            f"{folder}: expected a bake folder, found none; `skinbake bake CONFIG --out {folder}` makes one"
        )
    frames = sorted(path.parent.name for path in Path(folder).glob(f"*/{MANIFEST}"))
    if frames and not (Path(folder) / MANIFEST).is_file():
        raise InputError(f"{folder}: expected one bake, got several: {', '.join(frames[:5])} ...; name one")
    refuse_own_exports(Path(to))
    progress = Progress(verbosity > 0)
    for line in changed_since(look, named):
        progress.line(line)
    with progress.task("exporting"):
        written = write_exports(Path(folder), wanted, Path(to), progress.line)
    if verbosity:
        print(printable("\n".join(map(str, written))))
