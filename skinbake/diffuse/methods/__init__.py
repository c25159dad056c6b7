"""The diffusion methods, one class each. A new one is a file in this folder and a line in METHODS."""

from __future__ import annotations

from skinbake.diffuse.methods.hybrid import Hybrid
from skinbake.diffuse.methods.identity import Identity
from skinbake.diffuse.methods.method import RAISE_SIZE, DiffusionMethod, LobeParameters, LobePlan, Proposal
from skinbake.diffuse.methods.reference import Reference
from skinbake.diffuse.methods.stretch import Stretch
from skinbake.diffuse.methods.surface import Surface
from skinbake.diffuse.methods.texture import Texture
from skinbake.errors import InputError
from skinbake.scene.spec import AUTO

IDENTITY, REFERENCE = Identity(), Reference()

# In the order in which `auto` considers and messages list them
METHODS: dict[str, DiffusionMethod] = {
    method.name: method
    for method in (
        IDENTITY,
        Texture(),
        Stretch(),
        Hybrid(),
        Surface(),
        REFERENCE,
    )
}


def method_asked_for(name: str, normalise: bool = True) -> DiffusionMethod | None:
    """The method that `diffusion.method` names; None for `auto`.

    Raises
    ------
    InputError
        If there is no such method, or it does not know sums that are not normalised.
    """
    names = (AUTO, *(method.name for method in METHODS.values() if method.asked_for))
    if name not in names:
        raise InputError(f"diffusion.method: expected one of {', '.join(names)}, got {name}")
    method = None if name == AUTO else METHODS[name]
    if not normalise and not (method and method.classical):
        classical = (each.name for each in METHODS.values() if each.classical)
        raise InputError(f"diffusion: normalise: false needs method {' or '.join(classical)}, got {name}")
    return method


__all__ = [
    "IDENTITY",
    "METHODS",
    "RAISE_SIZE",
    "REFERENCE",
    "DiffusionMethod",
    "LobeParameters",
    "LobePlan",
    "Proposal",
    "method_asked_for",
]
