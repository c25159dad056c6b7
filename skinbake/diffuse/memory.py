"""What a bake will need before it begins."""

from __future__ import annotations

from skinbake.diffuse.methods import METHODS, method_asked_for
from skinbake.errors import MachineError
from skinbake.machine import physical_memory_bytes

LOADED_BYTES = 505 << 20  # libraries, compiled kernels, OpenGL and its picture, besides all textures
LOOKING_BYTES = 300  # of a texel that looks for skin that lights it: where it is, the skin that it sees, and its light
READ_BYTES = 560 << 20  # of temporary files, that are in memory at a time: `io.spool` lets them go then


def memory_needed_bytes(
    size: tuple[int, ...],
    lights: int,
    tiles: int = 1,
    lobes: int = 6,
    method: str = "auto",
    others: int = 0,
    on_disk: bool = False,
    looking: float = 0,
) -> int:
    """Peak memory of a bake's full textures, besides `LOADED_BYTES`, maps and mesh.

    Parameters
    ----------
    size : (height, width)
        Of the texture.
    lights, tiles, lobes : int
        How many of them.
    method : str
        `diffusion.method`; any method may come into use with `auto`.
    others : int
        How many lights lobes blur besides the first: each a source, its moments, its premultiplied copy and its leaves.
    on_disk : bool
        Whether what no step reads stands in temporary files, as in a bake into a folder.
    looking : float
        Texels that look for skin that lights them.

    Raises
    ------
    InputError
        If there is no such method.

    Notes
    -----
    On disk: what steps read, up to `READ_BYTES`, and what they make beside it, fitted to the sample head at 1024^2 to
    8192^2 with three lights: light that enters (30, 45 with others), or a lobe that is rounded (12 + 6 L).

    In memory, an upper estimate from the arrays that live together, per texel and tile: the atlas 20 bytes and the
    source 12 L are the caller's; each lobe kept at full size is 6 (L + 1), as halves with their sum (the three
    narrowest lobes, as a rule; the others are stored smaller and add half of one). `texture` holds a
    premultiplied copy with its pyramid, 16 L + 6. The 3-D methods hold points of the texels and of their extension
    (40 + 12), the texels as sources (8 + 12 L, and 24 in leaves), half as much again for one lobe's clusters, their
    moment pyramid (11 + 4 L) and the order in which they are written (4). `hybrid` lobes, which `auto` makes too, need
    both at once.
    """
    texels = size[0] * size[1] * tiles
    again = (12 + 4 + 16 + 12) * lights * others
    between = int(LOOKING_BYTES * looking)
    if on_disk:
        entering = 45 if others else 30
        return int(min(160 * texels, READ_BYTES) + texels * max(entering, 12 + 6 * lights)) + between
    kept = min(lobes, 3.5) * 6 * (lights + 1)
    per_texel = 20 + 12 * lights + kept
    surface = 52 + 1.5 * (32 + 12 * lights) + 11 + 4 * lights + 4
    per_texel += surface  # probes are checked against the surface integral, whatever the method
    fixed = method_asked_for(method)
    per_texel += max(each.memory_bytes_per_texel(lights) for each in ([fixed] if fixed else METHODS.values()))
    return int(texels * (per_texel + again)) + between


def disk_needed_bytes(size: tuple[int, ...], lights: int, tiles: int = 1, others: int = 0) -> int:
    """Temporary files of a bake, at their most; fitted to the sample head at 1024^2 and 4096^2.

    Parameters
    ----------
    size : (height, width)
        Of the texture.
    lights, tiles : int
        How many of them.
    others : int
        As of `memory_needed_bytes`.
    """
    return size[0] * size[1] * tiles * (100 + (100 + 45 * others) * lights)


def check_memory(
    size: tuple[int, ...],
    lights: int,
    tiles: int,
    lobes: int,
    method: str,
    others: int = 0,
    on_disk: bool = False,
    otherwise: str = "",
) -> None:
    """Refuse early what this machine cannot hold.

    Parameters
    ----------
    size, lights, tiles, lobes, method, others, on_disk
        See `memory_needed_bytes`.
    otherwise : str
        What else to change, in words.

    Raises
    ------
    MachineError
        With the memory it would need and what to change.
    """
    needed = memory_needed_bytes(size, lights, tiles, lobes, method, others, on_disk)
    there = physical_memory_bytes()
    if needed > there:
        raise MachineError(
            f"diffusion of {tiles} x {size[1]} x {size[0]} texels, {lights} light(s), needs about "
            f"{needed / 2**30:.0f} GiB of memory, this machine has {there / 2**30:.0f} GiB: lower texture.size, or set "
            f"output.lights to total{otherwise}"
        )
