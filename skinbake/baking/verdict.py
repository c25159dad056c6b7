"""The last lines of a bake: its picture, how good it is in words, what to do next, and what is probably not meant."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.baking.inputs import BakeInputs
from skinbake.io.output_names import PICTURE
from skinbake.numerics import Float
from skinbake.pipeline import Baked
from skinbake.scene.budget import FIT, is_within
from skinbake.scene.decision import uncounted_words
from skinbake.scene.mesh import SkinMesh

EDGE = 0.05  # of the height: top and bottom
LARGE_FIT = 0.5  # of the tolerance: from there on what the fit leaves wrong is said, though the look chose it
MIDDLE = 0.15  # of the extent: nearer to the middle than that is neither left nor right


def last_lines(folder: Path, manifest: Mapping[str, Any], picture: bool) -> list[str]:
    """Picture, exports, verdict and next command.

    Parameters
    ----------
    folder : Path
    manifest : mapping
        Of the bake.
    picture : bool
        Whether the folder has one of this bake.
    """
    here = as_typed(folder)
    exports = manifest.get("export", {}).get("folder")
    return [
        f"picture  {os.path.join(here, PICTURE)}" if picture else f"folder   {here}",
        *([f"exports  {os.path.join(here, exports)}"] if exports else []),
        f"verdict  {verdict(manifest)}",
        f"next     {_program()} preview {shlex.quote(here)}" + ("" if manifest["lobes"] else " --environment SKY.exr"),
    ]


def verdict(manifest: Mapping[str, Any]) -> str:
    """How far a bake is from what it approximates, in words.

    What was measured is said, and what was not: all that is left wrong, the blur's part of it at probes and where that
    is largest, the texture's estimated loss, and the distance from light transport where `truth` has measured that of
    these very lobes.
    """
    error, relight = manifest.get("error") or {}, manifest.get("relight")
    parts = [f"any light by {relight['textures']} textures"] if relight else []
    if not manifest["lobes"]:
        return parts[0]
    if error.get("rms") is not None:
        wanted, rms, left = manifest["config"]["diffusion"]["tolerance"], error["rms"], error.get("left_wrong")
        within = "within" if is_within(max(rms, left or 0.0), wanted) else "beyond"
        off = (
            f"off by {_percent(left)} from its own model, the blur by {_percent(rms)}"
            if left
            else f"the blur off by {_percent(rms)}"
        )
        worst = (error.get("worst") or {}).get("where")
        parts.append(f"{within} the {_percent(wanted)} asked for: {off}")
        parts.append(f"most {worst or 'at one point'}, by {_percent(error['max'])} of the mean")
    else:
        parts.append("the blur was not measured (diffusion.probes: 0)")
    if error.get("texture_size"):
        parts.append(f"the coarser texture loses about {_percent(error['texture_size'])}")
    if uncounted := uncounted_words(manifest.get("plan", ())):
        parts.append(uncounted)
    fit = next((line for line in manifest.get("plan", ()) if line["term"] == FIT), None)
    if fit and fit["error"] > LARGE_FIT * manifest["config"]["diffusion"]["tolerance"]:
        parts.append(f"beside that {fit['how']} are off from the skin's profile by {_percent(fit['error'])}")
    model = error.get("model")
    if model:
        noise = model["stderr"]
        found = f"less than {_percent(noise)}" if model["rms"] < noise else f"about {_percent(model['rms'])}"
        parts.append(f"{found} from light transport")
    else:
        parts.append("light transport not measured")
    return "; ".join(parts)


def where_on(mesh: SkinMesh, position_mm: Float) -> str:
    """A place of a mesh in words, by its bounding box: +z is the front, +x the head's own left, +y up.

    Parameters
    ----------
    mesh : SkinMesh
    position_mm : ndarray of shape (3,)
    """
    positions = mesh.positions_mm[np.unique(mesh.faces)]
    low, high = positions.min(axis=0), positions.max(axis=0)
    share = (position_mm - low) / np.maximum(high - low, 1e-9)
    depth = "front" if share[2] > 0.5 + MIDDLE else "back" if share[2] < 0.5 - MIDDLE else ""
    side = "left" if share[0] > 0.5 + MIDDLE else "right" if share[0] < 0.5 - MIDDLE else ""
    place = f"at the {depth} {side}".strip() if depth and side else f"at the {depth or side}" if depth or side else ""
    height = "at the bottom" if share[1] < EDGE else "at the top" if share[1] > 1 - EDGE else ""
    height = height or f"{100 * share[1]:.0f} % of the way up"
    return f"{place}, {height}" if place else f"in the middle, {height}"


def worst_place(inputs: BakeInputs, baked: Baked, before: Mapping[str, Any]) -> dict[str, Any] | None:
    """Where the blur is most wrong, as the manifest holds it.

    Parameters
    ----------
    inputs : BakeInputs
    baked : Baked
    before : mapping
        The last manifest: what it says of the same place is said again, without reading the mesh.
    """
    if baked.diffuse.worst_mm is None:
        return None
    place = [round(float(x), 3) for x in baked.diffuse.worst_mm]
    said = (before.get("error") or {}).get("worst") or {}
    if said.get("position_mm") == place:
        return dict(said)
    return {"position_mm": place, "where": where_on(inputs.scene().mesh, np.array(place))}


def _program() -> str:
    """How this program is called."""
    called = Path(sys.argv[0])
    if shutil.which("skinbake") or called.name != "skinbake":
        return "skinbake"
    return shlex.quote(as_typed(called))


def as_typed(folder: Path) -> str:
    """A path relative to the folder one is in, where it lies within."""
    inside = os.path.relpath(folder)
    return str(folder) if inside.startswith("..") else inside


def marked(warnings: Sequence[str]) -> list[str]:
    """Lines of warnings."""
    return [f"warning  {line}" for line in warnings]


def _percent(share: float) -> str:
    """Per cent with two digits that count."""
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"
