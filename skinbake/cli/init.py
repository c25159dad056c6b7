"""`skinbake init MESH`: a first look for a mesh."""

from __future__ import annotations

import click

from skinbake.cli.options import Output


@click.command("init")
@click.argument("mesh", type=click.Path(dir_okay=False))
@click.option("--out", type=Output(dir_okay=False), help="YAML file to write; by default the mesh's name, here.")
@click.option("--force", is_flag=True, help="Write over a file that is there.")
def command(mesh: str, out: str | None, force: bool) -> None:
    """Write a commented look for MESH that bakes as it stands: unit, parts and maps found, three lights placed.

    Beside it comes skinbake.schema.json, with which editors complete the look and check it.
    """
    import os
    from pathlib import Path

    from skinbake.cli.schema import schema_text
    from skinbake.errors import InputError, printable
    from skinbake.io.atomic import write_text
    from skinbake.io.first_look import first_look
    from skinbake.io.schema_file import HEADER, keep_schema
    from skinbake.progress import Progress

    path, look = Path(mesh), Path(out or Path(mesh).with_suffix(".yaml").name)
    if os.path.lexists(look) and not force:
        raise InputError(f"{look}: is there already; say --force to write over it, or --out for another name")
    if look.exists() and look.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{look}: expected a YAML file for --force to write over; choose another --out")
    with Progress().task("looking at the mesh"):
        text = first_look(path, look)
    if keep_schema(look.parent, schema_text()):
        text = f"{HEADER}\n{text}"
    write_text(look, text)
    print(printable(f"{look}\nnext: skinbake check {look}, then skinbake bake {look}"))
