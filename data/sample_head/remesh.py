"""Better-shaped triangles: collapse short edges, flip towards Delaunay, spread vertices along the surface."""

import numpy as np
from scipy.sparse import coo_matrix

from sample_head.charts import unique_edges


def face_normals(vertices, faces):
    """Area-weighted normals, shape (F, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def collapse_short(vertices, faces, shortest_mm):
    """Merge the ends of edges shorter than `shortest_mm` where that neither pinches nor folds the surface."""
    edges, _ = unique_edges(faces)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    short = np.flatnonzero(length < shortest_mm)
    corner = np.argsort(faces.ravel(), kind="stable")
    start = np.searchsorted(faces.ravel()[corner], np.arange(len(vertices) + 1))
    around = lambda v: corner[start[v] : start[v + 1]] // 3  # noqa: E731
    vertices, into = vertices.copy(), np.arange(len(vertices))
    busy = np.zeros(len(vertices), bool)
    for e in short[np.argsort(length[short], kind="stable")]:
        a, b = edges[e]
        ring = np.concatenate([faces[around(a)].ravel(), faces[around(b)].ravel()])
        if busy[ring].any():
            continue
        common = np.intersect1d(faces[around(a)], faces[around(b)])
        if len(common) != 4 or any(len(around(v)) <= 3 for v in common):  # a, b and the two corners opposite
            continue
        middle = (vertices[a] + vertices[b]) / 2
        touched = np.unique(np.concatenate([around(a), around(b)]))
        touched = touched[~((faces[touched] == a).any(1) & (faces[touched] == b).any(1))]
        corners = vertices[faces[touched]]
        before = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        corners[(faces[touched] == a) | (faces[touched] == b)] = middle
        after = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        if ((before * after).sum(1) < 0.0).any():
            continue
        vertices[a], into[b] = middle, a
        busy[ring] = True
    faces = into[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def drop_pillows(vertices, faces):
    """Remove pairs of faces that lie on each other, front to front, and vertices left without a face."""
    _, group, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    faces = faces[count[group] == 1]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def flip_edges(vertices, faces, smooth_cosine=0.8):
    """One pass of edge flips towards Delaunay where the surface is nearly flat across the edge."""
    edges, owner = unique_edges(faces)
    order = np.argsort(owner.ravel(), kind="stable")
    h0, h1 = order[0::2], order[1::2]  # closed surface: two half edges to each edge
    f0, f1 = h0 // 3, h1 // 3
    a, b = faces[f0, h0 % 3], faces[f0, (h0 % 3 + 1) % 3]
    c, d = faces[f0, (h0 % 3 + 2) % 3], faces[f1, (h1 % 3 + 2) % 3]

    def angle(p, q, r):
        u, v = vertices[q] - vertices[p], vertices[r] - vertices[p]
        return np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1))

    excess = angle(c, a, b) + angle(d, a, b) - np.pi
    unit = lambda n: n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)  # noqa: E731
    new0 = face_normals(vertices, np.stack([a, d, c], 1))
    new1 = face_normals(vertices, np.stack([d, b, c], 1))
    mean = unit(face_normals(vertices, faces[f0]) + face_normals(vertices, faces[f1]))
    old_flat = (unit(face_normals(vertices, faces[f0])) * unit(face_normals(vertices, faces[f1]))).sum(1)
    thin = (
        np.minimum(
            np.linalg.norm(face_normals(vertices, faces[f0]), axis=1),
            np.linalg.norm(face_normals(vertices, faces[f1]), axis=1),
        )
        < 1e-3
    )
    ok = (excess > 0.02) & ((old_flat > smooth_cosine) | thin)
    ok &= ((unit(new0) * mean).sum(1) > smooth_cosine) & ((unit(new1) * mean).sum(1) > smooth_cosine)
    valence = np.bincount(faces.ravel(), minlength=len(vertices))
    ok &= (valence[a] > 4) & (valence[b] > 4)
    n = len(vertices)
    key = np.minimum(c, d) * n + np.maximum(c, d)
    ok &= ~np.isin(key, edges[:, 0] * n + edges[:, 1])
    # each face takes part in one flip, the one that gains most; each new edge is made once
    rank = np.where(ok, excess, -np.inf)
    best = np.full(len(faces), -np.inf)
    np.maximum.at(best, f0, rank)
    np.maximum.at(best, f1, rank)
    take = np.flatnonzero(ok & (best[f0] == rank) & (best[f1] == rank))
    take = take[np.unique(key[take], return_index=True)[1]]
    _, once = np.unique(np.concatenate([f0[take], f1[take]]), return_index=True)
    good = np.zeros(2 * len(take), bool)
    good[once] = True
    take = take[good[: len(take)] & good[len(take) :]]
    faces = faces.copy()
    faces[f0[take]] = np.stack([a, d, c], 1)[take]
    faces[f1[take]] = np.stack([d, b, c], 1)[take]
    return faces, len(take)


def spread(vertices, faces, normals, amount=0.5):
    """Move each vertex towards the area-weighted middle of its triangles, along the surface only."""
    area = 0.5 * np.linalg.norm(face_normals(vertices, faces), axis=1)
    centre = vertices[faces].mean(1)
    n, m = len(vertices), len(faces)
    hit = coo_matrix((np.repeat(np.sqrt(area), 3), (faces.ravel(), np.repeat(np.arange(m), 3))), (n, m)).tocsr()
    move = hit @ centre / (hit @ np.ones(m))[:, None] - vertices
    move -= normals * (normals * move).sum(1, keepdims=True)
    return vertices + amount * move
