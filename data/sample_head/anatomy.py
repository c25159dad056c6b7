"""The sculpture: one function per anatomical part, all measures in millimetres.

Axes: x to the head's left, y up, z forward. The chin's underside is y = 0, the crown y = 230, the ear canals z = 0.
Parts are written for the left half (x > 0) and mirrored; `head_field` adds the small asymmetries of a real face.
"""

import numpy as np

from sample_head.sdf_primitives import (
    add_ellipsoid,
    add_tube,
    along,
    box,
    carve_ellipsoid,
    ellipsoid,
    near_curve,
    press_ball,
    press_curve,
    smooth_max,
    smooth_min,
    smoothstep,
    spline_points,
    table_column,
)

NECK_CUT_Y = -24.0
SOFTEN_MM = 4.0  # of the tables below, so that no section shows as a band

# Landmarks of the midline and the left half, adult averages.
LANDMARK = {
    "crown": (0, 230, -18),
    "glabella": (0, 136, 98),
    "nasion": (0, 120, 94),
    "pronasale": (0, 80, 117.5),
    "subnasale": (0, 68, 97),
    "stomion": (0, 48, 97),
    "pogonion": (0, 14, 95),
    "pupil": (31.5, 113, 85),
    "inner_canthus": (16, 111, 80),
    "outer_canthus": (45.5, 113, 74),
    "cheilion": (25.5, 47, 82),
    "alare": (18, 76, 93),
    "zygion": (68, 102, 33),
    "gonion": (56, 30, 10),
    "ear_canal": (68, 103, 0),
}

# Face block, horizontal sections: height, front z, half width, z of the widest place, squareness of the front.
FACE_SECTIONS = [
    (165, 82, 56, 0, 2.2),
    (150, 89, 61, 5, 2.25),
    (136, 92.5, 64, 12, 2.3),
    (121, 87.5, 66, 18, 2.3),
    (110, 84, 68, 20, 2.25),
    (100, 83.5, 68, 20, 2.2),
    (92, 85, 66, 19, 2.13),
    (85, 87, 63.0, 18, 2.05),
    (70, 92.5, 58.6, 15, 1.95),
    (58, 93.2, 56.2, 12, 1.87),
    (48, 92.6, 54.5, 10, 1.8),
    (38, 91.0, 53.6, 9, 1.72),
    (29, 89, 52.8, 8, 1.66),
    (20, 90.2, 51, 8, 1.7),
    (13, 92.0, 48.5, 8, 1.7),
    (4, 89.5, 47, 8, 1.65),
    (-10, 86, 45, 8, 1.5),
]
# Lower border of the jaw in side view: z, height.
JAW_LINE = [(110, 0), (90, 0), (75, 1), (55, 6), (35, 14), (18, 23), (6, 34), (-4, 52), (-12, 75), (-40, 130)]
# Neck: height, z of front, z of back, half width.
NECK_SECTIONS = [
    (-40, 31, -80, 63),
    (-24, 34, -74, 58.5),
    (-10, 37, -69, 56),
    (10, 41, -64, 53.5),
    (40, 42, -63, 52),
    (70, 35, -66, 51),
    (100, 30, -70, 50),
]


def cranium(x, y, z):
    """Brain case: an egg, wider at the back, in eight octants."""
    centre_y, centre_z = 152.0, -14.0
    ay = np.where(y > centre_y, 78.0, 76.0)
    az = np.where(z > centre_z, 110.5, 84.0)
    ax = 76.0
    p = 2.18 + 0.16 * smoothstep(0, 60, z) * smoothstep(150, 185, y)
    u, v, w = np.abs(x) / ax, np.abs(y - centre_y) / ay, np.abs(z - centre_z) / az
    rho = (u**p + v**p + w**p) ** (1 / p)
    radius = np.sqrt(x**2 + (y - centre_y) ** 2 + (z - centre_z) ** 2)
    return (1 - 1 / np.maximum(rho, 0.05)) * radius


def face_block(x, y, z):
    """Stack of horizontal sections from forehead to chin, cut off below along the jaw line."""
    front, half, widest, square = (table_column(FACE_SECTIONS, c, SOFTEN_MM)(y) for c in (1, 2, 3, 4))
    dz = z - widest
    x = np.sqrt(x**2 + 64.0) - 8.0 * np.exp(-((x / 17.0) ** 2))  # no crease at the midline
    back = 35.0 + 10.0 * smoothstep(40, 85, y)
    az = np.where(dz > 0, front - widest, back)
    p = np.where(dz > 0, square, 2.0)
    rho = (np.abs(x / half) ** p + np.abs(dz / az) ** p) ** (1 / p)
    side = (1 - 1 / np.maximum(rho, 0.05)) * np.hypot(x, dz)
    jaw = table_column(JAW_LINE, 1, SOFTEN_MM)
    border = jaw(z)
    slope = (jaw(z + 1) - jaw(z - 1)) / 2
    border = border + 0.006 * np.maximum(x - 10.0, 0.0) ** 2 * smoothstep(30, 70, z)
    under = (border - y) / np.sqrt(1 + slope**2)
    block = smooth_max(side, under, 14.0)
    return smooth_max(block, y - 172.0, 20.0)


def neck(x, y, z):
    """Column of the neck, leaning forward, widening to the shoulders."""
    front, back, half = (table_column(NECK_SECTIONS, c, SOFTEN_MM)(y) for c in (1, 2, 3))
    mid, az = (front + back) / 2, (front - back) / 2
    rho = np.sqrt((x / half) ** 2 + ((z - mid) / az) ** 2)
    column = (1 - 1 / np.maximum(rho, 0.05)) * np.hypot(x, z - mid)
    return smooth_max(column, y - 95.0, 30.0)


def skull_planes(f, x, y, z):
    """Large planes of brow, temple, cheek and jaw, pressed with the thumb."""
    press_ball(f, x, y, z, (62, 140, 58), (12, 20, 20), -3.0)  # temple hollow
    press_ball(f, x, y, z, (26, 168, 84), (15, 12, 15), 1.5)  # frontal eminence
    press_ball(f, x, y, z, (58, 178, -50), (26, 26, 26), 2.5)  # parietal eminence
    press_ball(f, x, y, z, (0, 137, 95), (11, 7, 12), 1.5)  # glabella
    press_ball(f, x, y, z, (17, 124.5, 87), (6, 6, 9), 1.3)  # inner corner below the brow
    press_curve(
        f,
        x,
        y,
        z,
        [
            (3, 131, 95, 6, 0.6),
            (12, 132, 95, 6, 1.0),
            (22, 134, 92, 6, 1.5),
            (34, 136.5, 86, 6, 1.6),
            (46, 134, 77, 6, 2.0),
            (53, 123, 67, 6, 1.8),
        ],
    )  # brow ridge
    press_curve(
        f,
        x,
        y,
        z,
        [
            (34, 95, 79, 9, 1.6),
            (45, 97, 70, 9, 2.4),
            (56, 100.5, 57, 10, 2.2),
            (66, 105, 36, 9, 0.6),
            (67, 108, 16, 8, 0.0),
        ],
    )  # cheekbone
    press_ball(f, x, y, z, (50, 66, 62), (14, 16, 17), -2.6)  # hollow under the cheekbone
    press_ball(f, x, y, z, (57, 38, 14), (8, 14, 14), 2.5)  # masseter
    press_ball(f, x, y, z, (33, 78, 82), (10, 10, 10), 2.2)  # apple of the cheek
    press_ball(f, x, y, z, (0, 12, 94), (13, 8, 10), 1.2)  # chin
    press_ball(f, x, y, z, (20, 26, 84), (8, 9, 10), -1.6)  # beside the chin


def eye(f, x, y, z):
    """Socket, closed lids over the eyeball, crease, slit."""
    carve_ellipsoid(f, x, y, z, (31, 114.0, 101), (21, 12.5, 19.2), 14.0)
    carve_ellipsoid(f, x, y, z, (16.5, 113, 92), (6.5, 8, 10.0), 9.0)
    add_ellipsoid(f, x, y, z, (31.0, 112.0, 71.4), (17.5, 14.0, 13.4), 7.0)
    # lid slit, upper lid margin, crease, fold below the lower lid
    for curve in (LID_SLIT, LID_MARGIN, LID_CREASE, LOWER_LID_FOLD):
        press_curve(f, x, y, LID_DEPTH * z, drawn_on_lids(curve))


LID_DEPTH = 0.3  # the lid curves are drawn in front view: depth counts for little


def drawn_on_lids(curve):
    """Rows of a lid curve with z scaled as `LID_DEPTH` asks."""
    return [(a, b, LID_DEPTH * c, *rest) for a, b, c, *rest in curve]


LID_SLIT = [
    (15.0, 110.2, 80.0, 0.9, -0.5),
    (18.0, 109.6, 81.5, 0.85, -1.1),
    (24, 107.2, 83.6, 0.85, -1.35),
    (31, 105.8, 84.0, 0.85, -1.35),
    (38, 106.8, 82.2, 0.85, -1.35),
    (43, 109.5, 79.0, 0.85, -1.1),
    (46.5, 111.6, 75.5, 0.9, -0.6),
]
LID_MARGIN = [
    (17, 111, 81, 0.9, 0.1),
    (24, 108.9, 84, 1.0, 0.5),
    (31, 107.5, 84.6, 1.0, 0.6),
    (38, 108.5, 83, 1.0, 0.5),
    (45, 112.5, 77, 0.9, 0.1),
]
LID_CREASE = [
    (17, 115, 79, 1.6, -0.1),
    (22, 119.3, 82, 1.4, -0.8),
    (30, 121.3, 83, 1.3, -1.4),
    (39, 120.3, 81, 1.3, -1.4),
    (46, 116.0, 76, 1.4, -0.7),
    (50, 113.0, 71, 1.5, -0.2),
]
LOWER_LID_FOLD = [
    (17, 106, 80, 2.4, -0.2),
    (24, 101, 82, 2.6, -0.6),
    (33, 99.0, 81, 2.8, -0.4),
    (42, 101.5, 77, 2.8, -0.1),
]


def nose(f, x, y, z):
    """Bridge, side walls, tip, wings, columella; nostrils carved last."""
    add_tube(
        f,
        x,
        y,
        z,
        [
            (0, 138, 79, 9.0),
            (0, 121, 77.5, 9.0),
            (0, 108, 80.5, 10.5),
            (0, 96, 86, 12.2),
            (0, 86, 91.5, 13),
            (0, 79, 94, 12.4),
        ],
        10.0,
    )
    add_tube(
        f,
        x,
        y,
        z,
        [
            (0, 138, 88, 5.0),
            (0, 128, 87.5, 4.6),
            (0, 119, 88.3, 4.0),
            (0, 108, 94.9, 4.1),
            (0, 97, 102.2, 4.8),
            (0, 86.5, 108, 6.0),
        ],
        7.0,
    )
    add_ellipsoid(f, x, y, z, (0, 81, 108.8), (8.2, 7.6, 8.6), 6.0)
    add_ellipsoid(f, x, y, z, (3.6, 79.8, 110.2), (5.6, 5.6, 6.2), 3.0)
    add_tube(f, x, y, z, [(0, 77, 109, 3.6), (0, 72.5, 104, 3.0), (0, 70, 96, 3.6)], 3.0)
    add_tube(
        f, x, y, z, [(7.5, 79.5, 108, 4.2), (12.5, 78.5, 103, 4.6), (14.0, 76.0, 97, 4.6), (13.0, 72.8, 92.5, 3.4)], 3.2
    )
    press_curve(
        f,
        x,
        y,
        z,
        [
            (14.0, 86.5, 98, 1.4, -0.2),
            (18.2, 83.0, 95, 1.3, -1.3),
            (19.4, 77, 92, 1.3, -1.9),
            (17.8, 72, 90.5, 1.4, -1.2),
            (15.5, 69.5, 90.5, 1.6, -0.3),
        ],
    )
    nostril = spline_points(
        [(6.2, 74.5, 107.0, 1.6), (7.6, 73.2, 103.2, 2.7), (8.8, 72.6, 98.8, 2.6), (8.0, 78.0, 97, 2.4)], 5
    )
    index, d, extra = near_curve(x, y, z, nostril, 8.0)
    f[index] = smooth_max(f[index], -(d - extra[:, 0]), 2.0)
    nostril = spline_points([(7.4, 69.5, 103.6, 2.4), (8.6, 69.0, 99.6, 2.4)], 4)
    index, d, extra = near_curve(x, y, z, nostril, 7.0)
    f[index] = smooth_max(f[index], -(d - extra[:, 0]), 2.0)


# Lips in front view: half width of the mouth line and its borders against |x|.
MOUTH_HALF = 25.5
# Fullness of the lips from the mouth line (0) past the border (1) to the skin.
UPPER_LIP = ([0, 0.2, 0.45, 0.8, 0.98, 1.08, 1.3, 1.7, 2], [0.70, 0.94, 1.0, 0.66, 0.40, 0.34, 0.12, 0, 0])
LOWER_LIP = ([0, 0.2, 0.5, 0.85, 1.0, 1.15, 1.6, 2], [0.56, 0.86, 1.0, 0.64, 0.36, 0.22, 0, 0])
UPPER_BORDER = [(0, 56.0, 0), (3, 56.7, 0), (6, 57.8, 0), (10, 57.1, 0), (16, 53.8, 0), (21, 50.6, 0), (25.5, 48.2, 0)]
MOUTH_LINE = [(0, 47.3, 0), (4, 47.6, 0), (9, 48.4, 0), (15, 48.0, 0), (21, 47.6, 0), (25.5, 47.9, 0)]
LOWER_BORDER = [(0, 37.6, 0), (6, 37.9, 0), (12, 39.4, 0), (18, 42.4, 0), (22.5, 45.4, 0), (25.5, 47.6, 0)]


def lip_coordinates(x, y):
    """How far up the upper lip (0 at the mouth line, 1 at its border) and down the lower one a place is, and the
    fullness there (1 at the middle, 0 at the corner)."""
    ax = np.minimum(np.abs(x), MOUTH_HALF)
    line = table_column(MOUTH_LINE, 1)(ax)
    upper = (y - line) / np.maximum(table_column(UPPER_BORDER, 1)(ax) - line, 0.8)
    lower = (line - y) / np.maximum(line - table_column(LOWER_BORDER, 1)(ax), 0.8)
    full = np.sqrt(np.clip(1 - (ax / MOUTH_HALF) ** 2, 0, 1))
    return upper, lower, full, y - line


def mouth(f, x, y, z):
    """Rounded lips with a defined border, mouth line, philtrum and corners."""
    i = box(x, y, z, (0, 48, 92), (34, 22, 30))
    if not len(i):
        return
    xi, yi, zi = x[i], y[i], z[i]
    upper, lower, full, above = lip_coordinates(xi, yi)
    inside = smoothstep(MOUTH_HALF + 3, MOUTH_HALF - 3, np.abs(xi)) * smoothstep(60, 72, zi)
    raise_mm = full**1.6 * (
        3.0 * along(*UPPER_LIP)(np.clip(upper, 0, 2)) * (upper > 0)
        + 4.0 * along(*LOWER_LIP)(np.clip(lower, 0, 2)) * (lower >= 0)
    )
    slit = (
        -1.7
        * np.exp(-0.5 * (above / 0.95) ** 2)
        * (0.35 + 0.65 * full)
        * smoothstep(MOUTH_HALF + 2, MOUTH_HALF - 1, np.abs(xi))
    )
    f[i] -= inside * raise_mm + slit * smoothstep(60, 72, zi)
    press_ball(f, x, y, z, (0, 50.5, 97), (3.5, 2.6, 8), 0.7)  # tubercle
    press_curve(f, x, y, z, [(0, 69, 96, 2.4, -0.5), (0, 63, 97, 2.6, -1.5), (0, 57.5, 99, 2.6, -1.3)])  # philtrum
    press_curve(
        f, x, y, z, [(4.6, 69, 96, 1.7, 0.4), (5.2, 63, 97, 1.7, 0.8), (6, 57.5, 98, 1.6, 0.9)]
    )  # philtral column
    press_ball(f, x, y, z, (27.5, 47.9, 81), (3.0, 3.2, 6), -1.2)  # corner of the mouth
    press_curve(
        f, x, y, z, [(0, 31, 93, 4.5, -1.3), (10, 31.5, 90, 4.5, -1.2), (18, 34.5, 86, 4, -0.9)]
    )  # mentolabial fold
    press_curve(
        f,
        x,
        y,
        z,
        [(20.5, 80, 89, 3.4, -1.2), (25.5, 70, 87, 3.4, -1.6), (30, 59, 83, 3.6, -1.1), (32, 49, 79, 3.8, -0.4)],
    )  # nasolabial


def ear_frame(x, y, z):
    """Ear coordinates: u to the back along the ear's plate, v up its long axis, w out of it."""
    lean, flare = np.radians(13.0), np.radians(27.0)
    dx, dy, dz = x - LANDMARK["ear_canal"][0], y - LANDMARK["ear_canal"][1], z - LANDMARK["ear_canal"][2]
    back = -np.sin(lean) * dy - np.cos(lean) * dz
    v = np.cos(lean) * dy - np.sin(lean) * dz
    u = np.cos(flare) * back + np.sin(flare) * dx
    w = np.cos(flare) * dx - np.sin(flare) * back
    return u, v, w


# Ear, in ear coordinates. Outline of the plate (u, v); the raised curves are u, v, w, radius.
EAR_OUTLINE = [
    (-7, 8),
    (-8, 18),
    (-4.5, 27),
    (4, 32),
    (13, 31.5),
    (20.5, 26),
    (24.5, 16),
    (24, 4),
    (20.5, -7),
    (15.5, -16),
    (9.5, -24.5),
    (4.5, -29),
    (-1.5, -28.5),
    (-5.5, -23),
    (-8, -12),
    (-7, -2),
]
HELIX = [
    (2.5, 2.0, -1.0, 1.6),
    (-3, 5.5, 2.2, 2.1),
    (-6.2, 11, 4.0, 2.3),
    (-7, 19, 5.0, 2.3),
    (-3, 26.5, 5.6, 2.4),
    (5, 30.2, 6.0, 2.4),
    (13, 29.3, 6.3, 2.4),
    (19.3, 24, 6.6, 2.4),
    (22.6, 15, 6.6, 2.3),
    (22.3, 4, 6.2, 2.2),
    (19, -6.5, 5.6, 2.0),
    (14.5, -15, 4.6, 1.8),
    (9.5, -21.5, 3.6, 1.6),
    (6, -25, 3.2, 1.2),
]
ANTIHELIX = [
    (8.5, -13.0, 3.6, 2.2),
    (13.2, -6, 4.8, 2.3),
    (14.8, 3, 5.6, 2.5),
    (13.4, 12, 5.4, 2.6),
    (9.5, 18.5, 4.2, 2.6),
]
ANTIHELIX_UPPER = [(12.0, 14, 5.0, 2.3), (12.0, 20, 4.2, 2.3), (10, 26, 3.4, 1.8)]
ANTIHELIX_LOWER = [(12.0, 13, 5.0, 2.2), (6, 17.5, 3.4, 1.9), (-1, 18.5, 2.2, 1.6)]


def polygon_distance(u, v, outline, smooth=True):
    """Signed distance to a closed curve in the plane, negative inside."""
    ring = spline_points(outline, 5, closed=True) if smooth else np.asarray(outline, float)
    best = np.full(len(u), np.inf)
    inside = np.zeros(len(u), bool)
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        e = b - a
        t = np.clip(((u - a[0]) * e[0] + (v - a[1]) * e[1]) / (e @ e), 0, 1)
        best = np.minimum(best, np.hypot(u - a[0] - t * e[0], v - a[1] - t * e[1]))
        cross = (a[1] > v) != (b[1] > v)
        if cross.any():
            inside ^= cross & (u < e[0] * (v - a[1]) / (e[1] if e[1] else 1e-12) + a[0])
    return np.where(inside, -best, best)


def ear_shell(u, v, w):
    """Bend of the auricle: it is a shell, not a board."""
    return w + 0.0035 * v**2 + 0.003 * (u - 8.0) ** 2 - 0.8


def ear_body(u, v, w):
    """Distance to the auricle without its hollows: thin plate, helix and antihelix laid on it, lobe, concha's wall."""
    outline = polygon_distance(u, v, EAR_OUTLINE)
    mid = 3.4 - 3.0 * np.exp(-0.5 * ((u + 9) / 6) ** 2)  # bends towards the head at the front
    g = smooth_max(outline + 1.2, np.abs(w - mid) - 1.5, 2.5)
    for path, k in ((HELIX, 2.2), (ANTIHELIX, 2.6), (ANTIHELIX_UPPER, 2.4), (ANTIHELIX_LOWER, 2.4)):
        add_tube(g, u, v, w, path, k)
    add_ellipsoid(g, u, v, w, (2.2, -22.0, 3.0), (6.2, 6.6, 2.4), 6.0)  # lobe
    add_ellipsoid(g, u, v, w, (-4.5, -17.0, -1.5), (4.0, 7.0, 5.0), 6.0)  # its root
    add_ellipsoid(g, u, v, w, (9.0, -13.5, 4.4), (4.0, 2.8, 2.6), 2.5)  # antitragus
    wall = ellipsoid(u, v, w, (4.5, 0.5, -5.0), (12.5, 17.0, 10.5))
    return smooth_min(g, wall, 4.0)


def ear(f, x, y, z):
    """Auricle: its body joined to the head, then bowl, cymba, fossa and canal pressed in; tragus."""
    i = box(x, y, z, (76, 104, -10), (26, 46, 36))
    if not len(i):
        return
    u, v, w = ear_frame(x[i], y[i], z[i])
    w = ear_shell(u, v, w)
    joined = smooth_min(f[i], ear_body(u, v, w), 4.5)
    for centre, radii, k in (
        ((4.2, -2.0, 5.5), (8.0, 9.5, 10.5), 2.2),  # bowl of the concha
        ((4.0, 8.5, 4.5), (7.8, 4.6, 6.5), 2.2),  # cymba
        ((4.5, 22.0, 6.2), (5.0, 3.0, 3.6), 2.0),  # triangular fossa
    ):
        joined = smooth_max(joined, -ellipsoid(u, v, w, centre, radii), k)
    add_tube(joined, u, v, w, HELIX[:4], 1.8)
    add_ellipsoid(joined, u, v, w, (-5.5, -2.5, 2.2), (3.6, 5.0, 4.2), 2.6)  # tragus
    f[i] = smooth_max(joined, -ellipsoid(u, v, w, (0.5, -2.5, -4.0), (3.0, 3.4, 5.0)), 1.6)  # canal


def throat(f, x, y, z):
    """Sternomastoid, larynx, nape."""
    press_curve(
        f, x, y, z, [(58, 66, -24, 8, 1.5), (54, 38, -10, 7, 3.2), (44, 6, 14, 6.5, 4.0), (31, -26, 31, 6, 4.2)]
    )
    press_ball(f, x, y, z, (0, -16, 36), (7, 9, 9), 1.8)


def canonical(points):
    """The symmetrical head's coordinates of places on the real one, shape (N, 3).

    Nobody is symmetric: nose and mouth drift a little to one side, one eye sits a little lower.
    """
    x, y, z = np.array(points, float).T
    front = smoothstep(20, 80, z)
    x -= front * (0.9 * np.sin((y - 20) / 42.0) - 0.35)
    y += front * 0.7 * np.tanh(x / 25.0) * np.sin((y - 10) / 45.0)
    return np.stack([x, y, z], axis=1)


def head_field(points):
    """Signed distance-like value of the head at each point, shape (N,): negative inside."""
    x, y, z = canonical(points).T
    x = np.abs(x)
    f = smooth_min(cranium(x, y, z), face_block(x, y, z), 16.0)
    f = smooth_min(f, neck(x, y, z), 13.0 + 9.0 * smoothstep(-10, -60, z))
    skull_planes(f, x, y, z)
    throat(f, x, y, z)
    eye(f, x, y, z)
    nose(f, x, y, z)
    mouth(f, x, y, z)
    ear(f, x, y, z)
    return smooth_max(f, NECK_CUT_Y - y, 2.0)
