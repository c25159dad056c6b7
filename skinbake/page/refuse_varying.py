"""Exports that know one weight a lobe refuse skin that varies, by its maps' names."""

from __future__ import annotations

from skinbake.errors import InputError
from skinbake.profile.weight_table import WeightTable


def refuse_varying(kind: str, table: WeightTable | None) -> None:
    """Stop where maps vary the skin.

    Parameters
    ----------
    kind : str
        Of the export.
    table : WeightTable, optional
        Of the bake.

    Raises
    ------
    InputError
        There is a table.
    """
    if table is not None:
        names = ", ".join(f"maps.{name}" for name in table.quantities)
        raise InputError(
            f"export --{kind}: expected skin that is the same everywhere, got {names};"
            " --sum, --layers and --gltf know it"
        )
