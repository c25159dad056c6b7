"""What is decided before textures are made."""

from __future__ import annotations

import pytest

import skinbake
from skinbake.errors import MachineError
from skinbake.relight import transfer


def test_textures_have_the_look_s_proportions(baked):
    """1024 texels on the longer side, or as many as the look's texture has, or as the look says."""
    look = baked.folder / "look.yaml"

    def size(*changes):
        return transfer.transfer_size(skinbake.load_look(look, list(changes)))

    assert size() == (60, 48)
    assert size("texture.size=[4096, 2048]") == (1024, 512)
    assert size("texture.size=[2048, 4096]", "relight.size=2000") == (1000, 2000)


def test_what_does_not_fit_is_refused(baked, monkeypatch):
    """With what it needs and what to change."""
    monkeypatch.setattr(transfer, "physical_memory_bytes", lambda: 2**20)
    with pytest.raises(MachineError, match=r"lower relight\.size or relight\.textures"):
        baked("relight.textures=9")
