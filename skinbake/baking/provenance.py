"""Where a stored result comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Provenance:
    """What is written beside a result.

    Attributes
    ----------
    key : str
        Digest of everything it depends on.
    inputs : mapping of role to str
        Digests of the files that were read for it.
    light_keys : mapping of light name to str
        Digests of what each light alone depends on, where lights are told apart.
    """

    key: str
    inputs: Mapping[str, str]
    light_keys: Mapping[str, str] = field(default_factory=dict)
