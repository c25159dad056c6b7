"""Open share of an environment's light at points of the skin: the same directions, asked from every point."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import OilLayer, albedo_at
from skinbake.irradiance.settled_rays import Answers, has_bit, no_answers, set_bit
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import for_slices
from skinbake.numerics import Float, safe_div

Image = NDArray[np.float32]
RAYS = 1 << 16  # that a thread has in memory at a time
NO_OIL = np.zeros((0, 0, 2))  # in place of the table of the oil's albedo


def open_shares(
    origin: Image,
    normal: Image,
    directions: Image,
    weights: Image,
    occluder: Occluder | None,
    oil: tuple[Image, Image, Float, Float] | None = None,
    answers: Answers | None = None,
) -> Image:
    """Share of R, G, B that arrives and passes the oil, and share of their sum that arrives, (n, 4).

    Parameters
    ----------
    origin, normal, directions, weights, occluder, oil, answers
        As `open_sums`.
    """
    return shares_of(open_sums(origin, normal, directions, weights, occluder, oil, answers))


def shares_of(sums: Float) -> Image:
    """Arriving over sent light, (n, 4), of `open_sums`; 0 where nothing is sent."""
    return safe_div(sums[:, 1], sums[:, 0]).astype(np.float32)


def open_sums(
    origin: Image,
    normal: Image,
    directions: Image,
    weights: Image,
    occluder: Occluder | None,
    oil: tuple[Image, Image, Float, Float] | None = None,
    answers: Answers | None = None,
) -> Float:
    """Light that directions send to points by the cosine, and the part that arrives; each R, G, B and their sum, (n,
    2, 4).

    The oil is taken off R, G, B of what arrives, not off their sum.

    Parameters
    ----------
    origin, normal : ndarrays of shape (n, 3)
        Where rays start, mm about the occluder's centre, and the smooth normals.
    directions, weights : ndarrays of shape (s, 3)
        As `SkySamples.draw` gives them.
    occluder : Occluder, optional
        None: nothing is in the way.
    oil : roughness (n,), strength (n,), table and f0 (n,), optional
    answers : ndarray of shape (n, 2, words), optional
        Rays that are settled already; completed by what is traced. Not where light may pass in part.
    """
    zero = np.zeros(len(origin), np.float32)
    roughness, strength, table, f0 = oil or (zero, zero, NO_OIL, np.zeros(len(origin)))
    directions, weights = np.ascontiguousarray(directions.T), np.ascontiguousarray(weights.T)
    out = np.empty((len(origin), 2, 4))
    answers = no_answers(len(origin), 0) if answers is None else answers

    def add_up(part: slice) -> None:
        starts, rays = (np.empty((len(out[part]) * directions.shape[1], 3), np.float32) for _ in range(2))
        count = aim(origin[part], normal[part], directions, answers[part], starts, rays)
        clear: NDArray[Any] = np.ones(count, np.bool_)
        if occluder is not None:
            clear = occluder.unhindered(starts[:count], rays[:count], np.full(count, np.inf, np.float32))
        _sum(
            clear,
            normal[part],
            directions,
            weights,
            OilLayer(roughness[part], strength[part], table, f0[part]),
            answers[part],
            out[part],
        )

    for_slices(add_up, len(origin), max(1, RAYS // directions.shape[1]))
    return out


@kernel(inline=True)
def _cosine(normal: Image, i: int, directions: Image, s: int) -> float:
    """Cosine between normal i (n, 3) and direction s of `directions` (3, s)."""
    return normal[i, 0] * directions[0, s] + normal[i, 1] * directions[1, s] + normal[i, 2] * directions[2, s]


@kernel
def aim(origin: Image, normal: Image, directions: Image, answers: Answers, starts: Image, rays: Image) -> int:
    """Rays from each point to the directions above its horizon that are not settled, point after point; their number.

    Parameters
    ----------
    origin, normal : ndarrays of shape (n, 3)
    directions : ndarray of shape (3, s)
    answers : ndarray of shape (n, 2, words)
    starts, rays : ndarrays of shape (at least n s, 3)
        Written: origins and directions.
    """
    count = 0
    for i in range(len(origin)):
        for s in range(directions.shape[1]):
            settled = answers.shape[2] > 0 and (has_bit(answers[i, 0], s) or has_bit(answers[i, 1], s))
            if not settled and _cosine(normal, i, directions, s) > 0.0:
                for axis in range(3):
                    starts[count, axis] = origin[i, axis]
                    rays[count, axis] = directions[axis, s]
                count += 1
    return count


@kernel
def _sum(
    clear: NDArray[Any],
    normal: Image,
    directions: Image,
    weights: Image,
    oil: OilLayer,
    answers: Answers,
    out: Float,
) -> None:
    """Sums of `open_sums` for some points, from the answers to `aim`'s rays.

    Parameters
    ----------
    clear : ndarray of shape (rays,), bool or float32
        Share of each ray that leaves the skin unhindered.
    normal : ndarray of shape (n, 3)
    directions, weights : ndarrays of shape (3, s)
    oil : OilLayer
        At the points.
    answers : ndarray of shape (n, 2, words)
        Completed.
    out : ndarray of shape (n, 2, 4)
        Written.
    """
    ray = 0
    for i in range(len(normal)):
        r, g, b, passed_r, passed_g, passed_b, passed = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for s in range(directions.shape[1]):
            cosine = _cosine(normal, i, directions, s)
            if not cosine > 0.0:
                continue
            of_r, of_g, of_b = cosine * weights[0, s], cosine * weights[1, s], cosine * weights[2, s]
            r, g, b = r + of_r, g + of_g, b + of_b
            if answers.shape[2] > 0 and has_bit(answers[i, 0], s):
                share = 1.0
            elif answers.shape[2] > 0 and has_bit(answers[i, 1], s):
                share = 0.0
            else:
                share = np.float64(clear[ray])
                ray += 1
                if answers.shape[2] > 0:
                    set_bit(answers[i, 0 if share > 0.0 else 1], s)
            if share > 0.0:
                lets = share
                if oil.table.size > 0:
                    albedo = albedo_at(oil.table, np.float64(cosine), np.float64(oil.roughness[i]), oil.f0[i])
                    lets *= min(max(1.0 - oil.strength[i] * albedo, 0.0), 1.0)
                passed_r, passed_g, passed_b = passed_r + of_r * lets, passed_g + of_g * lets, passed_b + of_b * lets
                passed += share * (of_r + of_g + of_b)
        out[i, 0, 0], out[i, 0, 1], out[i, 0, 2], out[i, 0, 3] = r, g, b, r + g + b
        out[i, 1, 0], out[i, 1, 1], out[i, 1, 2], out[i, 1, 3] = passed_r, passed_g, passed_b, passed
