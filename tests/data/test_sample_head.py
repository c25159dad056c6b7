"""The committed sample head keeps its promises: adult measures, closed mesh, clean unwrap, maps, registry."""

import hashlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

DATA = Path(__file__).resolve().parents[2] / "data"
TEXTURE = 1024


@cache
def head():
    """Arrays of head.obj: v, vt, vn and the corner indices (F, 3, 3) of v, vt, vn."""
    rows = {"v": [], "vt": [], "vn": [], "f": []}
    for line in (DATA / "head.obj").read_text().splitlines():
        kind, _, rest = line.partition(" ")
        if kind in rows:
            rows[kind].append(rest)
    corners = np.array(" ".join(rows["f"]).replace("/", " ").split(), dtype=int).reshape(-1, 3, 3) - 1
    arrays = {k: np.array(" ".join(rows[k]).split(), dtype=float).reshape(len(rows[k]), -1) for k in ("v", "vt", "vn")}
    return arrays["v"], arrays["vt"], arrays["vn"], corners


@cache
def edges_of(which):
    """Unique undirected edges over positions (0) or texture vertices (1), and how many faces use each."""
    f = head()[3][:, :, which]
    half = np.stack([f, np.roll(f, -1, axis=1)], -1).reshape(-1, 2)
    return np.unique(np.sort(half, axis=1), axis=0, return_counts=True)


def areas():
    """Area of each triangle in mm2 and, signed, in the unit square."""
    v, vt, _, f = head()
    p, q = v[f[:, :, 0]], vt[f[:, :, 1]]
    skin = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    a, b = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0]
    return skin, 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def charts():
    """Chart number of each texture vertex."""
    edges, _ = edges_of(1)
    label = np.arange(len(head()[1]))
    while True:
        low = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
        new = label.copy()
        np.minimum.at(new, edges[:, 0], low)
        np.minimum.at(new, edges[:, 1], low)
        new = new[new]
        if (new == label).all():
            return np.unique(label, return_inverse=True)[1]
        label = new


def coverage(size):
    """How many triangles hold each texel centre, and the chart found there (-1 where none)."""
    _, vt, _, f = head()
    chart = charts()[f[:, 0, 1]]
    count = np.zeros((size, size), int)
    owner = np.full((size, size), -1)
    tri = vt[f[:, :, 1]] * size - 0.5
    low = np.ceil(tri.min(1)).astype(int)
    span = np.maximum(np.floor(tri.max(1)).astype(int) - low + 1, 0)
    n = span.prod(1)
    face = np.repeat(np.arange(len(tri)), n)
    k = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    p = low[face] + np.stack([k % span[face, 0], k // span[face, 0]], 1)
    inside = np.ones(len(p), bool)
    for i in range(3):
        a, b = tri[face, i], tri[face, (i + 1) % 3]
        inside &= (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0]) > 0
    np.add.at(count, (p[inside, 1], p[inside, 0]), 1)
    owner[p[inside, 1], p[inside, 0]] = chart[face[inside]]
    return count, owner


def measure(select, axis, pick=np.max):
    """Extent of the selected vertices along an axis."""
    return float(pick(head()[0][select(*head()[0].T), axis]))


def test_size_is_that_of_an_adult_head():
    """Height, depth, breadth, cheekbones, jaw, neck, nose and ears are within a tenth of the adult averages."""
    v = head()[0]
    assert 230 <= np.ptp(v[:, 1]) <= 260

    def wide(low, high, back, front):
        return 2 * measure(lambda x, y, z: (y > low) & (y < high) & (z > back) & (z < front), 0)

    depth = measure(lambda x, y, z: (y > 125) & (y < 150) & (abs(x) < 5), 2) - v[:, 2].min()
    nose = measure(lambda x, y, z: (y > 70) & (y < 90) & (abs(x) < 4), 2) - measure(
        lambda x, y, z: (z > 60) & (y > 67) & (y < 71.5) & (abs(x) < 2), 2, np.min
    )
    found = {
        "crown to chin": (measure(lambda x, y, z: z < 200, 1) - 0.0, 230),
        "head length": (depth, 195),
        "head breadth": (wide(150, 200, -80, 80), 152),
        "cheekbones": (wide(95, 108, 25, 50), 138),
        "jaw": (wide(26, 34, 0, 40), 115),
        "neck": (wide(0, 10, -60, 0), 115),
    }
    for name, (got, adult) in found.items():
        assert got == pytest.approx(adult, rel=0.1), name
    assert 14 < nose < 24
    assert wide(60, 145, -40, 5) / 2 - 66 == pytest.approx(20, abs=4)  # ears stand out


def test_surface_passes_through_the_landmarks():
    """Brow, nose, mouth, chin, eyes and ears lie within 4 mm of where an adult has them."""
    landmarks = {
        "glabella": (0, 136, 98),
        "nasion, 120 above the chin": (0, 120, 94),
        "nose tip": (0, 80, 117.5),
        "nose base, 50 below the nasion": (0, 69, 97),
        "mouth": (0, 48, 97),
        "chin": (0, 14, 95),
    }
    for side in (1, -1):
        landmarks |= {
            f"pupil, 63 apart {side}": (31.5 * side, 113, 85),
            f"nose wing, 36 wide {side}": (18 * side, 76, 93),
            f"mouth corner, 51 wide {side}": (25.5 * side, 47.5, 82),
            f"cheekbone {side}": (68 * side, 102, 33),
            f"jaw angle {side}": (56 * side, 30, 10),
            f"ear rim, rear {side}": (86 * side, 108, -19),
        }
    v = head()[0]
    away = {name: np.linalg.norm(v - place, axis=1).min() for name, place in landmarks.items()}
    assert max(away.values()) < 4, away


def test_mesh_is_one_closed_manifold_of_the_promised_fineness():
    """30,000 to 80,000 triangles, two to every edge, of opposite turn, in one piece, none without area."""
    v, _, vn, f = head()
    assert 30_000 <= len(f) <= 80_000
    edges, uses = edges_of(0)
    assert (uses == 2).all()
    assert len(v) - len(edges) + len(f) == 2  # a sphere's: one piece without handles
    half = np.stack([f[:, :, 0], np.roll(f[:, :, 0], -1, axis=1)], -1).reshape(-1, 2)
    assert len(np.unique(half, axis=0)) == len(half)
    assert areas()[0].min() > 1e-5
    assert len(np.unique(f[:, :, 0])) == len(v)
    p = v[f[:, :, 0]]
    volume = np.einsum("ij,ij->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6
    assert volume > 3e6  # faces turn outward; a head is 3 to 5 litres
    face_normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    along = (face_normal[:, None] * vn[f[:, :, 2]]).sum(-1) / np.linalg.norm(face_normal, axis=1)[:, None]
    assert np.allclose(np.linalg.norm(vn, axis=1), 1, atol=2e-4)
    assert (along > 0.5).mean() > 0.999


def test_unwrap_has_no_flips_and_no_overlaps():
    """Every triangle has positive area in a unit square where no texel centre is covered twice."""
    vt = head()[1]
    assert vt.min() >= 0
    assert vt.max() <= 1
    assert areas()[1].min() > 0
    count, _ = coverage(TEXTURE)
    assert count.max() == 1
    assert 0.5 < (count == 1).mean() == pytest.approx(areas()[1].sum(), rel=2e-3)


def test_texels_are_about_the_same_size_everywhere():
    """Over 99.9 % of the skin's area the texel size stays within a factor of four, over 99 % within three."""
    skin, flat = areas()
    scale = np.sqrt(flat / skin)
    order = np.argsort(scale)
    share = np.cumsum(skin[order]) / skin.sum()

    def ratio(kept):
        low, high = np.interp([(1 - kept) / 2, (1 + kept) / 2], share, scale[order])
        return high / low

    assert ratio(0.999) < 4
    assert ratio(0.99) < 3


def test_charts_are_few_and_apart_and_share_a_seam():
    """At most eight charts, eight texels apart at 1024, joined by seams whose positions are shared."""
    v, vt, _, _f = head()
    number = charts().max() + 1
    assert 1 <= number <= 8
    assert len(vt) > len(v) + 300
    _edges, uses = edges_of(1)
    assert (uses == 1).sum() > 600
    _, owner = coverage(TEXTURE)
    reach = 7
    for dy in range(-reach, reach + 1):
        for dx in range(0, reach + 1):
            if np.hypot(dx, dy) <= reach:
                a = owner[max(dy, 0) : TEXTURE + min(dy, 0), dx:]
                b = owner[max(-dy, 0) : TEXTURE + min(-dy, 0), : TEXTURE - dx]
                assert not ((a >= 0) & (b >= 0) & (a != b)).any()


def test_face_stands_upright_in_the_texture():
    """On the face, up is +v and the head's left is +u."""
    v, vt, _, f = head()
    corner, texture = f[:, :, 0].ravel(), f[:, :, 1].ravel()
    face = (v[corner, 2] > 60) & (np.abs(v[corner, 0]) < 40) & (v[corner, 1] > 10)
    assert np.corrcoef(v[corner[face], 1], vt[texture[face], 1])[0, 1] > 0.98
    assert np.corrcoef(v[corner[face], 0], vt[texture[face], 0])[0, 1] > 0.98


def linear(name):
    """Map as floats 0 to 1; the sRGB encoding undone for the albedo."""
    image = np.asarray(Image.open(DATA / name)).astype(float) / 255
    if name != "albedo.png":
        return image
    return np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)


def texels_near(position, radius_mm):
    """Rows and columns of a 2048 map at the vertices near a place on the head."""
    v, vt, _, f = head()
    corner = np.linalg.norm(v[f[:, :, 0]] - position, axis=-1) < radius_mm
    uv = vt[f[:, :, 1][corner]]
    return ((1 - uv[:, 1]) * 2048).astype(int), (uv[:, 0] * 2048).astype(int)


def test_albedo_is_that_of_skin_and_the_lips_are_redder():
    """Cheeks and forehead reflect as pale skin does; the lips lose green and blue; the brows are dark."""
    albedo = linear("albedo.png")
    assert albedo.shape == (2048, 2048, 3)
    for place in ((30, 70, 84), (-30, 70, 84), (0, 155, 96)):
        r, g, b = albedo[texels_near(place, 12)].mean(0)
        assert 0.4 < r < 0.62
        assert 0.2 < g < 0.38
        assert 0.13 < b < 0.28
    skin, lips = albedo[texels_near((20, 60, 88), 6)].mean(0), albedo[texels_near((0, 42, 99), 5)].mean(0)
    assert lips[0] / lips[1] > 1.25 * skin[0] / skin[1]
    brow = albedo[texels_near((30, 134, 90), 4)].mean(0)
    assert brow.max() < 0.6 * albedo[texels_near((30, 150, 88), 5)].mean(0).max()


def test_roughness_is_lower_where_skin_is_oily():
    """Beckmann m: nose and lips below cheeks, cheeks below ears and neck; all within what skin shows."""
    m = linear("roughness.png")
    assert m.shape == (2048, 2048)
    at = lambda place, r: m[texels_near(place, r)].mean()  # noqa: E731
    nose, lips, cheek, neck = at((0, 95, 105), 8), at((0, 42, 99), 5), at((45, 75, 70), 8), at((40, -15, 25), 8)
    assert lips < nose < cheek < neck
    assert 0.18 <= lips < 0.26
    assert 0.33 < cheek < 0.42
    assert neck < 0.55


def test_pigments_and_cavity_lie_where_a_face_has_them():
    """Brows hold melanin, lips, nose and ears blood; pores hide a little of the oil, the folds beside the nose more."""
    maps = {}
    for name, most in (("melanin", 0.3), ("haemoglobin", 0.06), ("cavity", 1.0)):
        image = np.asarray(Image.open(DATA / f"{name}.png")).astype(float)
        maps[name] = most * np.kron(image / (65535 if most < 1 else 255), np.ones((2048 // len(image),) * 2))

    def at(name, place, radius):
        return maps[name][texels_near(place, radius)].mean()

    assert at("melanin", (30, 134, 90), 4) > 3 * at("melanin", (30, 150, 88), 5)
    assert 0.005 < at("melanin", (30, 70, 84), 12) < 0.03
    cheek, forehead = at("haemoglobin", (44, 84, 72), 8), at("haemoglobin", (0, 155, 96), 8)
    assert at("haemoglobin", (0, 42, 99), 5) > 1.3 * cheek > 1.3 * 1.3 * forehead
    assert at("haemoglobin", (0, 95, 105), 8) > forehead
    assert 0.7 < at("cavity", (30, 70, 84), 12) < 1
    assert at("cavity", (19, 76, 91), 4) < at("cavity", (30, 70, 84), 12)


def test_normals_are_unit_and_lean_little():
    """The tangent-space normals are unit to 8 bits, face outward, and carry relief everywhere on the face."""
    n = linear("normal.png") * 2 - 1
    assert n.shape == (2048, 2048, 3)
    assert np.abs(np.linalg.norm(n, axis=-1) - 1).max() < 0.02
    lean = np.degrees(np.arccos(np.clip(n[:, :, 2], -1, 1)))
    face = lean[texels_near((0, 80, 100), 70)]
    assert 2 < np.sqrt((face**2).mean()) < 15
    assert np.abs(n[texels_near((0, 80, 100), 70)].mean(0)[:2]).max() < 0.01


@pytest.mark.slow
def test_maps_are_defined_past_the_charts():
    """Eight texels outside a chart the albedo still looks like the skin at its border, not like the background."""
    albedo = linear("albedo.png")
    _, owner = coverage(2048)
    rows = np.arange(TEXTURE)
    checked = 0
    for row in 2048 - 1 - rows[(rows > 300) & (rows % 8 == 0)]:
        line = owner[2048 - 1 - row] >= 0
        if not line.any():
            continue
        first = line.argmax()
        inside, outside = albedo[row, first : first + 4].mean(0), albedo[row, first - 7 : first].mean(0)
        assert np.abs(inside - outside).max() < 0.25
        checked += 1
    assert checked > 50


def test_registry_names_every_file_with_its_hash_and_licence():
    """registry.txt lists each committed file once, with the sha256 of its bytes and the MIT line."""
    lines = [
        line.split(maxsplit=2) for line in (DATA / "registry.txt").read_text().splitlines() if line and line[0] != "#"
    ]
    maps = ["albedo.png", "cavity.png", "haemoglobin.png", "head.obj", "melanin.png", "normal.png", "roughness.png"]
    assert sorted(name for name, _, _ in lines) == maps
    for name, digest, licence in lines:
        assert hashlib.sha256((DATA / name).read_bytes()).hexdigest() == digest
        assert "our own work" in licence
        assert "MIT" in licence
        assert (DATA / name).stat().st_size < 8e6
    assert (DATA / "head.obj").stat().st_size < 6e6
