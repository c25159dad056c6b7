"""Parts by name: what is baked, what only casts shadows, what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.mesh.parts import choose_parts
from skinbake.io.mesh.raw_mesh import RawMesh

PATH = Path("hero.glb")


def character(bare=()):
    """One triangle for each part; `bare` ones have no UVs."""
    names = (
        ("Head", "Skin"),
        ("Neck", "Skin"),
        ("EyeLeft", "Cornea"),
        ("EyeRight", "Cornea"),
        ("Hair_1",),
        ("Lashes",),
    )
    count = len(names)
    has_uv = np.array([number not in bare for number in range(count)])
    return RawMesh(
        np.eye(3), np.tile(np.arange(3, dtype=np.int32), (count, 1)), np.zeros((count, 3, 2)), has_uv,
        np.zeros((count, 3, 3)), np.arange(count, dtype=np.int32), names,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("skin", "cast", "ignore", "wanted"),
    [
        ((), (), (), "SSSSSS"),
        ((), ("Eye*", "Hair*"), ("Lash*",), "SSCCCI"),
        (("Head*", "Neck"), ("Eye*", "Hair*"), ("Lash*",), "SSCCCI"),
        (("Skin",), (), (), "SSCCCC"),  # what skin leaves out casts
        (("*",), ("Cornea",), ("EyeRight",), "SSCISS"),  # ignore goes before cast, cast before skin
        (("Head/Skin",), (), ("Eye?*",), "SCIICC"),
    ],
)
def test_roles(skin, cast, ignore, wanted):
    """By names of nodes, meshes and materials, with * and ?."""
    roles = choose_parts(PATH, character(), skin, cast, ignore)
    assert "".join(role[0].upper() for role in roles.of_part) == wanted
    np.testing.assert_array_equal(roles.skin, [letter == "S" for letter in wanted])
    np.testing.assert_array_equal(roles.cast, [letter == "C" for letter in wanted])
    assert roles.notes == ()


def test_parts_without_uvs_only_cast():
    """Where others have UVs, and with a note on each; not where UVs are made anew."""
    roles = choose_parts(PATH, character(bare=(2, 4)))
    np.testing.assert_array_equal(roles.cast, [False, False, True, False, True, False])
    np.testing.assert_array_equal(roles.skin, ~roles.cast)
    assert [note.split(":")[0] for note in roles.notes] == ["EyeLeft/Cornea", "Hair_1"]
    assert choose_parts(PATH, character(bare=(2, 4)), uvs_needed=False).skin.all()


@pytest.mark.parametrize(
    ("options", "bare", "message"),
    [
        ({"skin": ["Hat"]}, (), "mesh.skin: no part is called 'Hat'; there are Head, Skin, Neck, EyeLeft"),
        ({"cast": ["eye*"]}, (), "mesh.cast: no part is called 'eye*'"),
        ({"ignore": ["*"]}, (), "expected a part that is skin, got none"),
        ({"skin": ["Head", "Eye*"]}, (2,), "mesh.skin: expected UVs, EyeLeft/Cornea has none; .* mesh.cast"),
        ({}, range(6), "expected UVs, the mesh has none; .* set texture.unwrap: xatlas"),
    ],
)
def test_what_cannot_be_chosen_is_refused(options, bare, message):
    """With the key, the names that there are, or the way out."""
    with pytest.raises(InputError, match=message.replace("*'", r"\*'")):
        choose_parts(PATH, character(bare), **options)
