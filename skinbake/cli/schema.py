"""`skinbake schema`: the JSON schema of a look, or the page of every key."""

from __future__ import annotations

import click


@click.command("schema")
@click.option("--reference", is_flag=True, help="The page of every key, in Markdown.")
def command(reference: bool) -> None:
    """Print the JSON schema of a look: editors complete and check looks with it."""
    import json

    from skinbake.diffuse.methods import METHODS
    from skinbake.scene.schema import look_schema, reference_page

    methods = [method.name for method in METHODS.values() if method.asked_for]
    text = reference_page(methods) if reference else json.dumps(look_schema(methods), indent=1)
    click.echo(text, nl=not reference)
