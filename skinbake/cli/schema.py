"""`skinbake schema`: the JSON schema of a look, or the page of every key."""

from __future__ import annotations

import click


@click.command("schema")
@click.option("--reference", is_flag=True, help="The page of every key, in Markdown.")
def command(reference: bool) -> None:
    """Print the JSON schema of a look: editors complete and check looks with it."""
    click.echo(reference_text() if reference else schema_text(), nl=False)


def schema_text() -> str:
    """The schema as JSON."""
    import json

    from skinbake.scene.schema import look_schema

    return json.dumps(look_schema(_methods()), indent=1) + "\n"


def reference_text() -> str:
    """The page of every key."""
    from skinbake.scene.schema import reference_page

    return reference_page(_methods())


def _methods() -> list[str]:
    from skinbake.diffuse.methods import METHODS

    return [method.name for method in METHODS.values() if method.asked_for]
