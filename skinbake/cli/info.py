"""`skinbake info FILE|FOLDER`: where it came from."""

from __future__ import annotations

import json
from pathlib import Path

import click

from skinbake.cli.options import json_option


@click.command("info")
@click.argument("path", type=click.Path())
@json_option
def command(path: str, as_json: bool) -> None:
    """Show version, inputs, lobes, error and plan of a bake folder, or the header of one EXR."""
    from skinbake.io.exr import read_attributes
    from skinbake.io.manifest import read_manifest

    found = read_manifest(path) if Path(path).is_dir() else read_attributes(path)
    if as_json:
        print(json.dumps(found, indent=1, default=str))
        return
    for name, value in found.items():
        if isinstance(value, dict):
            print(name)
            for key, inner in value.items():
                print(f"  {key:<24} {inner}")
        elif isinstance(value, list):
            print(name)
            for inner in value:
                print(
                    "  " + (", ".join(f"{k} {v}" for k, v in inner.items()) if isinstance(inner, dict) else str(inner))
                )
        else:
            print(f"{name:<26} {value}")
