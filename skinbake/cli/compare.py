"""`skinbake compare A B`: two images, or two bakes lobe by lobe."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbake.cli.options import Output, Within, json_option

if TYPE_CHECKING:
    from skinbake.compare import Difference

limit = Within(min=0)
MOST_ROWS = 16  # of a picture: a bake with tiles has a hundred images
_WHOLE = 0.999  # coverage of a texel that shows nothing but skin
_LIGHT = ("irradiance", "lobe_", "transmission", "sum of lobes")  # names of what a bake stores begin so


@click.command("compare")
@click.argument("image", type=click.Path())
@click.argument("reference", type=click.Path())
@click.option("--absolute", type=limit, default=1e-6, show_default=True, help="Limit of a value, absolute part.")
@click.option(
    "--relative", type=limit, default=1e-3, show_default=True, help="Limit of a value, part of the reference."
)
@click.option(
    "--allowed", type=limit, default=0.0, show_default=True, help="Share of the values that may pass their limit."
)
@click.option(
    "--worst", type=limit, default=1.0, show_default=True, help="No value may pass this many times its limit."
)
@click.option(
    "--picture",
    type=Output(dir_okay=False),
    help=f"Write differences in false colours to this PNG, the {MOST_ROWS} largest.",
)
@json_option
def command(
    image: str,
    reference: str,
    absolute: float,
    relative: float,
    allowed: float,
    worst: float,
    picture: str | None,
    as_json: bool,
) -> int:
    """Compare IMAGE with REFERENCE: two EXR or image files, or two bake folders, lobe by lobe and their weighted sum.

    Lobes of two bakes that are stored at different sizes are read at the larger one, and compared on the skin alone.
    The first line is the verdict.
    Shares are of the reference: of its rms, and of its largest value.
    Exit codes: 0 same, 1 differs, 2 could not compare.
    """
    from skinbake.compare import Tolerance, compare
    from skinbake.errors import InputError, printable
    from skinbake.io.output_names import refuse_inputs
    from skinbake.io.pictures import false_colour_sheet, images_of
    from skinbake.progress import Progress

    if picture:
        folders = [Path(side) for side in (image, reference) if Path(side).is_dir()]
        refuse_inputs([picture], [image, reference, *(file for folder in folders for file in folder.iterdir())])
    tolerance = Tolerance(absolute, relative, allowed, worst)
    with Progress().task("comparing"):
        ours, theirs = images_of(Path(image)), images_of(Path(reference))
        if Path(image).is_dir() and Path(reference).is_dir():
            _of_two_bakes(Path(image), Path(reference), ours, theirs)
        found = {name: compare(ours[name], theirs[name], tolerance) for name in ours if name in theirs}
    missing = sorted(set(ours) ^ set(theirs))
    pairs = {n: (ours[n], theirs[n]) for n in found if ours[n].shape == theirs[n].shape}
    same = not missing and all(d.same for d in found.values())
    if as_json:
        print(
            json.dumps(
                {"same": same, "images": {n: _figures(d) for n, d in found.items()}, "missing": missing}, indent=1
            )
        )
    if not pairs:
        got = next(iter(found.values())).why if found else "none of one name"
        raise InputError(f"{image} and {reference}: expected images of one name and shape, got {got}")
    if not as_json:
        print(printable(_verdict(found, missing)))
        for name, d in found.items():
            rms, most = _both(d.rms, d.relative_rms), _both(d.max_absolute, d.max_relative)
            print(printable(f"{name:<40} rms {rms}  max {most}  {d.why}"))
        for name in missing:
            print(printable(f"{name:<40} only in {image if name in ours else reference}"))
    if picture:
        shown = sorted(pairs, key=lambda name: _most(found[name]), reverse=True)[:MOST_ROWS]
        false_colour_sheet(Path(picture), {name: pair for name, pair in pairs.items() if name in shown})
        if len(pairs) > MOST_ROWS:
            print(printable(f"{picture}: the {MOST_ROWS} of {len(pairs)} images that differ most"), file=sys.stderr)
    return 0 if same else 1


def _verdict(found: dict[str, Difference], missing: list[str]) -> str:
    """One line: whether all is the same, else how much is not and what is worst."""
    differ = {name: d for name, d in found.items() if not d.same}
    if not differ and not missing:
        return f"same: {len(found)} image{'s' if len(found) > 1 else ''} within the limits"
    parts = []
    if differ:
        worst = max(differ, key=lambda name: _most(differ[name]))
        parts.append(f"{len(differ)} of {len(found)} images; most {worst or 'the image'}: {differ[worst].why}")
    if missing:
        parts.append(f"{len(missing)} in one of them only")
    return f"differs: {'; '.join(parts)}"


def _most(difference: Difference) -> float:
    """How far two images are apart; infinite where that cannot be said."""
    return difference.max_relative if math.isfinite(difference.max_relative) else math.inf


def _both(value: float, share: float) -> str:
    """A difference as it is, and as a share of the reference."""
    return f"{value:.3e} ({share:.3%})"


def _figures(difference: Difference) -> dict[str, Any]:
    """For JSON, which has no NaN and no infinity: null."""
    figures = asdict(difference)
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in figures.items()}


def _of_two_bakes(image: Path, reference: Path, ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Bring light and lobes to one size, and add what they sum to.

    Of bakes whose textures differ in size, or a lobe of them, only texels that show nothing but skin in the larger one
    are compared: how far light is carried on beyond the charts depends on the size.
    """
    from skinbake.compare import read_at
    from skinbake.errors import InputError
    from skinbake.io.manifest import read_manifest
    from skinbake.io.pictures import diffuse_of

    try:
        sums = [diffuse_of(folder, read_manifest(folder)) for folder in (image, reference)]
    except InputError:  # folders of images, or half a bake: what is there is compared
        sums = [{}, {}]
    for images, found in zip((ours, theirs), sums, strict=True):
        images.update({f"sum of lobes {tile}".strip(): values for tile, values in found.items()})
    covered = _covered(ours, theirs)
    for name in ours.keys() & theirs.keys():
        if not name.startswith(_LIGHT):
            continue
        if ours[name].shape != theirs[name].shape:
            height, width = [max(pair) for pair in zip(ours[name].shape, theirs[name].shape, strict=True)][:2]
            ours[name], theirs[name] = (read_at(values[name], height, width) for values in (ours, theirs))
        tile = next((tile for tile in covered if tile and tile in name), "")
        if tile in covered:
            skin = read_at(covered[tile], *ours[name].shape[:2]) >= _WHOLE
            ours[name], theirs[name] = ours[name] * skin, theirs[name] * skin


def _covered(ours: dict[str, Any], theirs: dict[str, Any]) -> dict[str, Any]:
    """Coverage (H, W, 1) of the larger of two textures by tile ("" where there is one); none where all sizes agree."""
    found, both = {}, [name for name in ours.keys() & theirs.keys() if name.startswith(_LIGHT)]
    if all(ours[name].shape == theirs[name].shape for name in both):
        return {}
    for name in both:
        larger = max(ours[name], theirs[name], key=lambda image: image.shape)
        total = name.startswith("irradiance") and name.endswith(" irradiance") and larger.shape[-1] == 4
        if total:
            found[name.partition(".exr")[0].removeprefix("irradiance").strip(".")] = larger[..., 3:]
    return found
