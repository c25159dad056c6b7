"""A table of weights as plain lists, in profile.json and bake.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbake.profile.weight_table import MOST_AXES, WeightTable
from skinbake.scene.maps import OF_SKIN

KEY = "weights_table"


def table_record(table: WeightTable) -> dict[str, Any]:
    """A table as plain lists: `names`, `nodes`, `weight_rgb`, `error_rgb`, the worst node, ..."""
    where, error = table.worst
    return {
        "names": list(table.names),
        "nodes": [nodes.tolist() for nodes in table.nodes],
        "weight_rgb": table.weight_rgb.tolist(),
        "error_rgb": table.error_rgb.tolist(),
        "between_rgb": table.between_rgb.tolist(),
        "worst": {"at": where, "relative_error": error},
        "constants": dict(table.constants),
        "scatters": table.scatters,
    }


def table_of_record(record: dict[str, Any] | None, gaussians: int) -> WeightTable | None:
    """The table of a record of `table_record`; None where there is none.

    Parameters
    ----------
    record : dict, optional
    gaussians : int
        How many weights a row has.

    Raises
    ------
    ValueError, LookupError, TypeError
        It is damaged.
    """
    if record is None:
        return None
    nodes = [np.array(each, np.float64) for each in record["nodes"]]
    weight, error, between = (np.array(record[name], np.float64) for name in ("weight_rgb", "error_rgb", "between_rgb"))
    names, constants = tuple(map(str, record["names"])), {k: float(v) for k, v in record["constants"].items()}
    grid = tuple(len(each) for each in nodes)
    if len(nodes) != MOST_AXES or len(names) > MOST_AXES or weight.shape != (*grid, gaussians, 3):
        raise ValueError(f"{KEY}: expected weights of shape {(*grid, gaussians, 3)}, got {weight.shape}")
    if unknown := set(names) - (set(OF_SKIN) - {"scatter"}):
        raise ValueError(f"{KEY}: expected names of maps, got {', '.join(sorted(unknown))}")
    finite = all(np.isfinite(each).all() for each in (*nodes, weight, error, between, np.array([*constants.values()])))
    if error.shape != (*grid, 3) or between.ndim != error.ndim or not finite:
        raise ValueError(f"{KEY}: expected finite weights, with an error a node")
    if any(np.any(np.diff(each) <= 0) or each[0] < 0 for each in nodes):
        raise ValueError(f"{KEY}: expected nodes that ascend from 0 or more")
    scatters = bool(record["scatters"])
    if missing := {*names, *(["scatter"] if scatters else [])} - constants.keys():
        raise ValueError(f"{KEY}: expected constants of {', '.join(sorted(missing))}")
    return WeightTable(names, (nodes[0], nodes[1]), weight, error, between, constants, scatters)


def table_csv(table: WeightTable, variance_mm2: np.ndarray) -> str:
    """Rows of a table as lines that begin with #, which readers of a profile's CSV pass over.

    Parameters
    ----------
    table : WeightTable
    variance_mm2 : ndarray of shape (N,)
    """
    axes = [*table.names, *["-"] * (MOST_AXES - len(table.names))]
    weights = [f"weight_{c}({v:.6g} mm2)" for v in variance_mm2 for c in "RGB"]
    lines = [f"# {KEY}", "# " + ",".join([*axes, "error_R", "error_G", "error_B", *weights])]
    for k, first in enumerate(table.nodes[0]):
        for j, second in enumerate(table.nodes[1]):
            row = [first, second, *table.error_rgb[k, j], *table.weight_rgb[k, j].ravel()]
            lines.append("# " + ",".join(f"{value:.6g}" for value in row))
    return "\n".join(lines) + "\n"
