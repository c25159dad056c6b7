"""Skin on the head: colour, gloss and relief as functions of the place in millimetres.

Everything is noise in three dimensions or strokes and dots set on the surface, read at each texel's place on the head,
so there is no seam and no stretch. Random numbers come from fixed seeds.
"""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from sample_head import anatomy
from sample_head.charts import ear_value
from sample_head.sdf_primitives import near_curve, smoothstep, spline_points

LATTICE = 96

# Linear albedo of the bare skin, and what melanin and blood take from it (log units per unit of pigment).
BASE = np.array([0.570, 0.335, 0.232])
MELANIN = np.array([0.42, 0.72, 1.0])
BLOOD = np.array([0.14, 0.92, 0.82])
HAIR = np.array([0.034, 0.020, 0.013])
# Volume fractions of the bare skin, and the most that the maps hold
LIGHT_MELANIN, MOST_MELANIN = 0.011, 0.3
LIGHT_BLOOD, MOST_BLOOD = 0.0055, 0.06

# Hair line in side view (z, y), closed far above the head.
HAIR_LINE = [
    (130, 187),
    (84, 187),
    (73, 181),
    (62, 166),
    (52, 152),
    (40, 144),
    (28, 138),
    (25, 120),
    (22, 102),
    (13, 100),
    (11, 122),
    (6, 139),
    (-12, 141),
    (-24, 122),
    (-27, 92),
    (-30, 66),
    (-48, 50),
    (-80, 46),
    (-140, 46),
    (-140, 260),
    (130, 260),
]
# Brow: x, y, half height, of the left one.
BROW = [(12.5, 130.2, 3.0), (19, 132.0, 3.7), (28, 134.0, 3.5), (38, 135.2, 2.8), (46, 133.6, 2.0), (53, 129.8, 0.9)]


def noise(points, period_mm, seed):
    """Smooth noise of mean 0 and deviation about 1; `period_mm` may be three numbers."""
    lattice = np.random.default_rng(seed).standard_normal((LATTICE,) * 3).astype(np.float32)
    place = (points / np.asarray(period_mm, float)).T + 7.3 * (seed % 11)
    return map_coordinates(lattice, place.astype(np.float32), order=2, prefilter=False, mode="grid-wrap") / 0.405


def layered(points, periods, weights, seed):
    """Sum of noises, deviation about 1."""
    total = sum(w * noise(points, p, seed + i) for i, (p, w) in enumerate(zip(periods, weights, strict=True)))
    return total / np.sqrt(np.sum(np.square(weights)))


def blob(q, centre, radii):
    """Soft patch: 1 at the centre of the left or right side, fading over `radii` mm."""
    d2 = ((np.abs(q[:, 0]) - centre[0]) / radii[0]) ** 2
    for axis in (1, 2):
        d2 = d2 + ((q[:, axis] - centre[axis]) / radii[axis]) ** 2
    return np.exp(-0.5 * d2)


def sides(q):
    """Left half and mirrored right half as the left: |x|, y, z."""
    return np.abs(q[:, 0]), q[:, 1], q[:, 2]


def curve_mask(q, points, reach, depth=1.0):
    """Distance to a curve of the left half (and its mirror image), `reach` or more counted as `reach`."""
    x, y, z = sides(q)
    z = depth * z
    path = spline_points(np.asarray(points, float)[:, :3] * [1, 1, depth])
    index, distance, _ = near_curve(x, y, z, path, reach)
    out = np.full(len(q), float(reach))
    out[index] = np.minimum(distance, reach)
    return out


class Zones:
    """Soft masks, 0 to 1, of the parts of the face that differ in colour, gloss or relief."""

    def __init__(self, position, normal):
        q = anatomy.canonical(position)
        x, y, z = sides(q)
        self.q, self.position = q, position
        wobble = layered(position, (9, 4, 1.8), (1, 0.6, 0.35), 100)
        self.ear = smoothstep(-1.5, 1.5, ear_value(position))
        upper, lower, _full, _ = anatomy.lip_coordinates(q[:, 0], y)
        along = smoothstep(anatomy.MOUTH_HALF - 0.5, anatomy.MOUTH_HALF - 5.0, x + 0.4 * wobble)
        jag = 0.05 * wobble
        self.lips = along * (z > 66) * smoothstep(1.18, 0.88, upper + jag) * smoothstep(1.18, 0.85, lower + jag)
        self.mouth_line = curve_mask(q, [(a, b, 97 - 0.022 * a * a) for a, b, _ in anatomy.MOUTH_LINE], 8.0)
        self.lid = blob(q, (31, 112, 84), (13, 7.5, 12))
        self.socket = blob(q, (31, 113, 82), (19, 12, 14))
        self.under_eye = blob(q, (27, 101, 80), (12, 4.5, 10))
        self.inner_eye = blob(q, (17, 111, 79), (4.5, 6, 8))
        self.slit = np.where(z > 60, curve_mask(q, anatomy.LID_SLIT, 6.0, anatomy.LID_DEPTH), 6.0)
        self.crease = np.where(z > 60, curve_mask(q, anatomy.LID_CREASE, 6.0, anatomy.LID_DEPTH), 6.0)
        self.cheek = blob(q, (44, 84, 72), (17, 15, 18))
        self.nose = blob(q, (0, 81, 110), (13, 9, 12))
        self.wing = blob(q, (15.5, 77, 96), (5, 7, 7))
        self.alar_crease = blob(q, (19, 76, 91), (2.6, 7, 5))
        self.chin = blob(q, (0, 14, 94), (15, 9, 14))
        self.forehead = smoothstep(138, 150, y) * smoothstep(55, 80, z)
        self.t_zone = np.maximum(
            self.forehead * np.exp(-0.5 * (x / 30) ** 2),
            np.exp(-0.5 * (x / 11) ** 2) * smoothstep(68, 78, y) * (z > 60),
        )
        self.neck = smoothstep(8, -6, y - 0.18 * np.maximum(60 - z, 0)) * smoothstep(95, 70, z)
        edge = anatomy.polygon_distance(z + 2.2 * wobble, y + 2.0 * wobble, HAIR_LINE, smooth=False)
        self.scalp = smoothstep(6.0, -11.0, edge) * (1 - self.ear)
        beard = smoothstep(4, -10, y - 66 + 0.45 * np.maximum(60 - z, 0) - 8 * smoothstep(30, 60, x)) * smoothstep(
            0, 22, z
        )
        self.beard = (
            np.maximum(beard, blob(q, (9, 63, 96), (13, 5.5, 10))) * (1 - self.lips) * smoothstep(-22, -4, y + 0.1 * z)
        )
        self.upright = normal[:, 1]


def scatter_points(position, weight, count, seed):
    """`count` indices into the texels, drawn in proportion to `weight`."""
    total = np.cumsum(weight)
    return np.searchsorted(total, np.random.default_rng(seed).random(count) * total[-1])


def dots(position, centres, radius, depth):
    """Sum over the three nearest dots of depth * exp(-(d / radius)^2)."""
    reach = float(2.5 * radius.max())
    distance, index = cKDTree(centres).query(position, k=3, distance_upper_bound=reach, workers=-1)
    safe = np.minimum(index, len(centres) - 1)
    value = depth[safe] * np.exp(-((distance / radius[safe]) ** 2))
    return np.where(np.isfinite(distance), value, 0.0).sum(1)


def strokes(position, where, roots, tips_offset, bend, width, samples, lay=None):
    """How much of each texel hair covers, 0 to 1. Hairs are arcs from `roots` along `tips_offset`, laid on the skin.

    `where` are the texels that can be covered. `lay` sets places of the front view on the skin (`depth_from_front`);
    without it the hairs are pressed halfway to the nearest skin.
    """
    t = np.linspace(0, 1, samples)
    line = roots[:, None] + tips_offset[:, None] * t[None, :, None] + bend[:, None] * (t * (1 - t))[None, :, None]
    line = line.reshape(-1, 3)
    if lay is None:
        line = (position[where][cKDTree(position[where]).query(line, workers=-1)[1]] + line) / 2
    else:
        line = lay(line[:, :2])
    thick = np.repeat(width, samples) * np.tile(1 - 0.75 * t**2, len(roots))
    distance, index = cKDTree(line).query(position[where], k=6, distance_upper_bound=1.2, workers=-1)
    safe = np.minimum(index, len(line) - 1)
    cover = np.where(np.isfinite(distance), np.exp(-((distance / thick[safe]) ** 2)), 0.0)
    # samples of one hair must not count twice: the strongest, and half of the strongest of another hair
    hair = np.where(np.isfinite(distance), safe // samples, -1)
    first = cover.max(1)
    other = np.where(hair != hair[np.arange(len(hair)), cover.argmax(1)][:, None], cover, 0).max(1)
    out = np.zeros(len(position))
    out[where] = 1 - (1 - first) * (1 - 0.7 * other)
    return out


def depth_from_front(q):
    """Function that sets places of the front view, (N, 2), on the skin: (N, 3)."""
    tree = cKDTree(q[:, :2])
    return lambda p: np.column_stack([p, q[tree.query(p)[1], 2]])


def brow_hair(zones):
    """Cover of the brows: a few hundred single hairs that rise from the inner end and lie down along the ridge."""
    q = zones.q
    where = np.flatnonzero((np.abs(q[:, 0]) < 64) & (np.abs(q[:, 1] - 131) < 16) & (q[:, 2] > 45))
    depth = depth_from_front(q[where])
    cover = np.zeros(len(q))
    for side in (1, -1):
        rng = np.random.default_rng(20 + side)
        n = 470
        path = spline_points(BROW, 12)
        s = rng.beta(1.0, 1.15, n)
        place = np.stack([np.interp(s, np.linspace(0, 1, len(path)), path[:, c]) for c in range(3)], 1)
        across = np.clip(rng.normal(0, 0.5, n), -1, 1)
        x = place[:, 0] + rng.normal(0, 0.7, n)
        y = place[:, 1] + across * place[:, 2]
        angle = np.radians(
            np.interp(s, [0, 0.12, 0.35, 0.65, 1], [70, 48, 22, 2, -24])
            - 22 * across * smoothstep(0.05, 0.4, s)
            + rng.normal(0, 7, n)
        )
        length = np.interp(s, [0, 0.25, 0.7, 1], [5.5, 8.0, 8.5, 6.0]) * rng.uniform(0.7, 1.1, n)
        step = np.stack([np.cos(angle), np.sin(angle)], 1) * length[:, None]
        ends = np.stack([x, y], 1) + step
        root = depth(np.column_stack([side * x, y]))
        tip = depth(ends * [side, 1])
        bend = np.column_stack([side * rng.uniform(0, 1.5, n), rng.uniform(-1.0, 0.2, n), np.zeros(n)])
        cover = np.maximum(cover, strokes(q, where, root, tip - root, bend, rng.uniform(0.11, 0.18, n), 40, depth))
    return cover


def lash_hair(zones):
    """Cover of the lashes along the closed slit."""
    q = zones.q
    where = np.flatnonzero((zones.slit < 5.9) & (q[:, 2] > 60))
    depth = depth_from_front(q[where])
    path = spline_points(np.asarray(anatomy.LID_SLIT)[1:, :3], 10)
    cover = np.zeros(len(q))
    for side in (1, -1):
        rng = np.random.default_rng(40 + side)
        n = 95
        s = np.sort(rng.random(n))
        root = np.stack([np.interp(s, np.linspace(0, 1, len(path)), path[:, c]) for c in range(3)], 1)
        root[:, 1] += rng.normal(-0.1, 0.15, n)
        angle = np.radians(np.interp(s, [0, 0.5, 1], [-112, -88, -48]) + rng.normal(0, 7, n))
        length = np.interp(s, [0, 0.4, 0.85, 1], [1.8, 3.2, 4.6, 3.6]) * rng.uniform(0.75, 1.1, n)
        tip = depth((root[:, :2] + np.column_stack([np.cos(angle), np.sin(angle)]) * length[:, None]) * [side, 1])
        root = depth(root[:, :2] * [side, 1])
        step = tip - root
        bend = np.column_stack([np.zeros(n), -0.5 * np.ones(n), np.zeros(n)])
        cover = np.maximum(cover, strokes(q, where, root, step, bend, rng.uniform(0.11, 0.16, n), 24, depth))
    return cover


def scalp_hair(zones, area):
    """Cover of the cropped hair: short strokes, forward on top and down at the sides."""
    where = np.flatnonzero(zones.scalp > 0.01)
    rng = np.random.default_rng(60)
    n = 120000
    pick = where[scatter_points(zones.position[where], zones.scalp[where] ** 1.5 * area[where], n, 61)]
    root = zones.position[pick]
    flow = np.stack(
        [
            0.25 * np.sign(root[:, 0]),
            -0.35 - 0.5 * smoothstep(215, 150, root[:, 1]),
            0.8 * smoothstep(-80, 10, root[:, 2]),
        ],
        1,
    )
    flow = flow + rng.normal(0, 0.28, (n, 3))
    length = rng.uniform(0.7, 1.4, n) * (0.5 + 0.5 * zones.scalp[pick])
    step = flow / np.linalg.norm(flow, axis=1, keepdims=True) * length[:, None]
    return strokes(zones.position, where, root, step, np.zeros((n, 3)), rng.uniform(0.085, 0.115, n), 6)


def stubble(zones, area):
    """Cover of the shaved beard: dark points under the skin."""
    where = np.flatnonzero(zones.beard > 0.02)
    pick = where[scatter_points(zones.position[where], zones.beard[where] * area[where], 11000, 70)]
    rng = np.random.default_rng(71)
    cover = np.zeros(len(zones.q))
    cover[where] = dots(
        zones.position[where],
        zones.position[pick],
        rng.uniform(0.13, 0.2, len(pick)),
        rng.uniform(0.25, 0.6, len(pick)),
    )
    return cover * zones.beard


def pigments(zones, area):
    """Melanin and blood at each texel beside those of the bare skin, in the units of MELANIN and BLOOD, (T,) each."""
    p = zones.position
    broad = layered(p, (45, 22, 11), (1, 0.8, 0.5), 1)
    mottle = layered(p, (6, 3.2, 1.6), (1, 0.8, 0.6), 5)
    grain = layered(p, (0.9, 0.5), (1, 0.7), 9)
    vessels = 1 - np.abs(noise(p, 3.5, 12)) - 0.5 * np.abs(noise(p, 1.7, 13))
    vessels = np.clip(vessels, 0, 1) ** 2

    blood = 0.04 * broad + 0.035 * mottle + 0.02 * grain
    blood += 0.21 * zones.cheek * (1 + 0.15 * mottle) + 0.22 * zones.nose + 0.18 * zones.wing + 0.3 * zones.alar_crease
    blood += 0.24 * zones.ear + 0.12 * zones.chin + 0.16 * zones.socket + 0.2 * zones.inner_eye + 0.1 * zones.lid
    blood += 0.12 * vessels * (zones.cheek + zones.nose + zones.wing)
    blood += -0.06 * zones.forehead - 0.03 * zones.neck
    blood += zones.lips * (0.38 + 0.06 * mottle + 0.1 * noise(p, (0.9, 4, 4), 15))
    blood += 0.3 * np.exp(-((zones.mouth_line / 1.2) ** 2)) * zones.lips

    melanin = 0.05 * layered(p, (30, 12), (1, 0.7), 20) + 0.03 * mottle + 0.022 * grain
    melanin += (
        0.16 * zones.socket + 0.12 * zones.under_eye + 0.22 * zones.lips + 0.05 * zones.forehead + 0.06 * zones.neck
    )
    melanin += 0.10 * np.exp(-((zones.crease / 1.5) ** 2)) + 0.22 * np.exp(-((zones.slit / 1.4) ** 2))
    melanin += spots(zones, area)
    return melanin, blood


def dark_hair(zones, hair):
    """How much of each texel hair, lashes and the roots of lashes hide, (T,)."""
    lash_line = 0.75 * np.exp(-((zones.slit / 0.55) ** 2)) * smoothstep(5, 1, zones.slit)
    return 1 - (1 - 0.88 * hair["brow"]) * (1 - 0.55 * hair["scalp"]) * (1 - 0.9 * hair["lash"]) * (1 - lash_line) * (
        1 - 0.45 * hair["beard"]
    )


def fractions(zones, hair, area):
    """Volume fractions of melanin in the epidermis and of blood in the dermis at each texel, (T,) each."""
    melanin, blood = pigments(zones, area)
    melanin = LIGHT_MELANIN * np.exp(2.2 * melanin) + 0.28 * dark_hair(zones, hair) + 0.05 * zones.scalp
    return np.clip(melanin, 0.001, MOST_MELANIN), np.clip(LIGHT_BLOOD * np.exp(3.4 * blood), 0.0005, MOST_BLOOD)


def cavity(texels, zones, height):
    """Share of the oil that is seen at each texel: less in pores and folds, where the rim hides it, (T,)."""
    h = texels.image(height, 0.0)[..., 0]
    known = texels.image(np.ones(len(height)), 0.0)[..., 0]
    around = gaussian_filter(h * known, 6.0) / np.maximum(gaussian_filter(known, 6.0), 1e-3)
    below = (around - h)[texels.row, texels.col]
    seen = 1 - 0.8 * smoothstep(0.004, 0.055, below)
    seen *= 1 - 0.55 * zones.alar_crease - 0.5 * np.exp(-((zones.mouth_line / 0.9) ** 2)) * zones.lips
    return np.clip(seen * (1 - 0.5 * np.exp(-((zones.slit / 0.8) ** 2))), 0.05, 1)


def albedo(zones, hair, area):
    """Linear Rec.709 albedo at each texel, shape (T, 3)."""
    p = zones.position
    melanin, blood = pigments(zones, area)
    colour = BASE * np.exp(-np.clip(melanin, -0.2, 3)[:, None] * MELANIN - np.clip(blood, -0.2, 3)[:, None] * BLOOD)
    # veins below the thin skin of the lids, shaved beard: both bluish
    colour *= 1 - zones.under_eye[:, None] * np.array([0.10, 0.06, 0.02])
    colour *= 1 - zones.beard[:, None] * np.array([0.085, 0.06, 0.045])
    colour *= 1 - zones.scalp[:, None] * np.array([0.46, 0.45, 0.42])
    dark = dark_hair(zones, hair)
    tint = HAIR * (1 + 0.25 * noise(p, 2.0, 30))[:, None]
    return colour * (1 - dark[:, None]) + tint * dark[:, None]


def spots(zones, area):
    """Melanin of freckles and a few moles."""
    p = zones.position
    rng = np.random.default_rng(80)
    where = zones.cheek * 1.6 + zones.nose + 0.5 * zones.forehead + 0.12
    where = where * (1 - zones.lips) * (1 - zones.scalp) * (zones.q[:, 1] > -20) * (zones.q[:, 2] > -20)
    pick = scatter_points(p, where * area, 900, 81)
    freckles = dots(p, p[pick], rng.uniform(0.35, 1.0, 900), rng.uniform(0.04, 0.2, 900))
    centres = np.array(
        [(38, 62, 74), (-47, 88, 66), (-22, 152, 88), (52, 20, 30), (-30, 34, 74), (14, 88, 92), (-48, -6, 12)], float
    )
    nearest = cKDTree(p).query(centres)[1]
    moles = dots(
        p, p[nearest], np.array([1.1, 0.9, 0.8, 1.4, 0.7, 0.6, 1.5]), np.array([1.2, 0.9, 0.6, 1.0, 0.8, 0.5, 0.9])
    )
    return freckles * (1 + 0.4 * noise(p, 0.7, 82)) + moles


def roughness(zones, hair):
    """Beckmann m at each texel."""
    m = 0.375 + 0.02 * layered(zones.position, (14, 5, 1.2), (1, 0.7, 0.6), 200)
    m += -0.10 * zones.t_zone - 0.05 * zones.nose - 0.03 * zones.chin - 0.03 * zones.lid + 0.05 * zones.neck
    m += 0.07 * zones.ear + 0.02 * zones.beard + 0.06 * zones.scalp
    m = m * (1 - zones.lips) + zones.lips * (0.225 + 0.02 * noise(zones.position, 1.5, 205))
    m += 0.10 * hair["brow"] + 0.05 * hair["scalp"]
    return np.clip(m, 0.18, 0.6)


def relief(zones, hair, area):
    """Height of the fine relief above the mesh, mm, at each texel."""
    p, q = zones.position, zones.q
    rng = np.random.default_rng(300)
    smooth_skin = (1 - zones.lips) * (1 - 0.6 * zones.lid)
    # plates of the fine relief: height falls to the borders between cells
    cells = p[scatter_points(p, area, 130000, 301)]
    d = cKDTree(cells).query(p, k=2, workers=-1)[0]
    height = 0.022 * (smoothstep(0.0, 0.45, d[:, 1] - d[:, 0]) - 0.5) * smooth_skin
    height += 0.020 * layered(p, (2.2, 1.1, 0.6), (1, 0.9, 0.7), 310) * (1 - 0.5 * zones.lips)
    # pores, larger on nose and cheeks
    dense = (
        (0.25 + zones.nose + zones.wing + 0.9 * zones.cheek + 0.5 * zones.forehead + 0.4 * zones.chin)
        * smooth_skin
        * (1 - 0.8 * zones.scalp)
    )
    dense = dense * (1 - 0.8 * zones.ear) * (1 - 0.5 * zones.neck)
    pick = scatter_points(p, dense * area, 34000, 320)
    size = rng.uniform(0.22, 0.34, len(pick)) + 0.06 * dense[pick].clip(0, 1.2)
    height -= dots(p, p[pick], size, rng.uniform(0.02, 0.06, len(pick)) * (0.6 + 0.6 * dense[pick].clip(0, 1.2)))
    # creases of the forehead, fine folds of the lids and at the outer corner of the eye
    sway = 2.2 * noise(q, 26, 330) + 0.5 * noise(q, 7, 331)
    for y, depth in ((150, 0.05), (158.5, 0.08), (167.5, 0.07), (177, 0.045)):
        line = q[:, 1] + sway - y - 0.0022 * q[:, 0] ** 2
        fade = zones.forehead * smoothstep(50, 24, np.abs(q[:, 0])) * np.clip(0.65 + 0.45 * noise(q, 18, 332), 0, 1.2)
        height -= depth * fade * np.exp(-((line / 0.75) ** 2))
    fold = np.abs(noise(q, (7, 0.85, 7), 340))
    height -= 0.055 * np.exp(-((fold / 0.35) ** 2)) * np.clip(zones.lid * 1.1, 0, 1) * smoothstep(0.3, 1.2, zones.slit)
    corner = np.abs(noise(q, (6, 1.4, 6), 341))
    height -= 0.05 * np.exp(-((corner / 0.3) ** 2)) * blob(q, (53, 111, 66), (6, 8, 9))
    under = np.abs(noise(q + np.stack([0 * q[:, 0], 0.25 * np.abs(q[:, 0]), 0 * q[:, 0]], 1), (8, 1.3, 8), 342))
    height -= 0.035 * np.exp(-((under / 0.3) ** 2)) * zones.under_eye
    # lips: creases across the lip, fanning to the corners
    fan = np.stack([q[:, 0] * (1 - 0.012 * np.abs(q[:, 1] - 47)), 0.10 * q[:, 1], 0.10 * q[:, 2]], 1)
    crease = np.abs(noise(fan, 0.95, 350))
    height += zones.lips * (0.035 * noise(fan, 1.9, 351) - 0.060 * np.exp(-((crease / 0.3) ** 2)))
    # rings of the neck
    ring = np.abs(noise(p, (30, 2.6, 30), 360))
    height -= 0.035 * np.exp(-((ring / 0.3) ** 2)) * zones.neck
    height += 0.07 * hair["brow"] + 0.05 * hair["scalp"] + 0.03 * hair["beard"] + 0.06 * hair["lash"]
    return height


def tangent_normals(texels, height):
    """Tangent-space normals of the relief, components -1 to 1, shape (T, 3).

    Convention (OpenGL, +Y green): with N the interpolated vertex normal, tangent T = dP/du made orthogonal to N and
    unit, bitangent B = dP/dv made orthogonal to N and T and unit (towards +v; UVs are never mirrored, so B = N x T).
    The map's r, g, b are 2c - 1 = the new normal's components along T, B, N. u runs to the right, v up; row 0 is v = 1.
    """
    size = texels.size
    grid = texels.image(height, float(height.mean()))[:, :, 0]
    dh_du = (np.roll(grid, -1, 1) - np.roll(grid, 1, 1)) * (size / 2)
    dh_dv = (np.roll(grid, 1, 0) - np.roll(grid, -1, 0)) * (size / 2)
    dh_du, dh_dv = dh_du[texels.row, texels.col], dh_dv[texels.row, texels.col]
    n = texels.normal
    unit = lambda a: a / np.linalg.norm(a, axis=1, keepdims=True)  # noqa: E731
    flat_u = texels.dp_du - n * (n * texels.dp_du).sum(1, keepdims=True)
    flat_v = texels.dp_dv - n * (n * texels.dp_dv).sum(1, keepdims=True)
    tangent = unit(flat_u)
    bitangent = np.cross(n, tangent)
    # slope g in the tangent plane with g . dP/du = dh/du and g . dP/dv = dh/dv
    ut, vt, vb = (flat_u * tangent).sum(1), (flat_v * tangent).sum(1), (flat_v * bitangent).sum(1)
    slope_t = dh_du / ut
    slope_b = (dh_dv - slope_t * vt) / vb
    slope_t, slope_b = np.clip(slope_t, -1.5, 1.5), np.clip(slope_b, -1.5, 1.5)
    return unit(np.stack([-slope_t, -slope_b, np.ones(len(n))], 1))


def paint(texels):
    """All maps at the painted texels: linear albedo (T, 3), Beckmann roughness (T,), tangent normals (T, 3), volume
    fractions of melanin and of blood (T,) each, and the oil's cavity (T,).
    """
    zones = Zones(texels.position, texels.normal)
    area = np.linalg.norm(np.cross(texels.dp_du, texels.dp_dv), axis=1) * texels.inside
    hair = {
        "brow": brow_hair(zones),
        "lash": lash_hair(zones),
        "scalp": scalp_hair(zones, area),
        "beard": stubble(zones, area),
    }
    height = relief(zones, hair, area)
    coats = albedo(zones, hair, area), roughness(zones, hair), tangent_normals(texels, height)
    return *coats, *fractions(zones, hair, area), cavity(texels, zones, height)
