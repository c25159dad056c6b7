"""Where the skin is cut for the unwrap: split the mesh along smooth seam lines, then label the charts."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from sample_head.anatomy import EAR_OUTLINE, NECK_CUT_Y, ear_body, ear_frame, ear_shell, polygon_distance
from sample_head.sdf_primitives import smooth_max, smoothstep

HEAD, CAP, EAR_FRONT, EAR_BACK = 0, 1, 2, 4  # ears: + 1 on the head's right side
EAR_COLLAR = 3.0  # mm
BACK_SEAM_FRONT = 22.0  # the seam over the back of the head starts on the crown, at this z


def ear_value(points):
    """Positive on the auricle and EAR_COLLAR mm of the skin around its root, zero along the seam to the head."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    u, v, w = ear_frame(x, y, z)
    w = ear_shell(u, v, w)
    value = np.full(len(points), -10.0)
    near = np.flatnonzero((x > 50) & (np.abs(y - 104) < 46) & (np.abs(z + 10) < 36))
    u, v, w = u[near], v[near], w[near]
    bowl = 12.0 - np.hypot(np.hypot(u - 3.5, (v - 2.0) * 0.75), np.minimum(w + 8, 0))
    lobe_root = 11.0 - np.hypot(np.hypot(u + 3.0, (v + 17.0) * 0.8), w)
    collar = smooth_max(EAR_COLLAR - ear_body(u, v, w), lobe_root, 5.0)
    value[near] = np.maximum(smooth_max(collar, bowl, 5.0), -10.0)
    return value


def rim_value(points):
    """Positive on the front of the auricle, negative on its back, zero along the rim."""
    u, v, w = ear_frame(np.abs(points[:, 0]), points[:, 1], points[:, 2])
    w = ear_shell(u, v, w)
    outline = polygon_distance(u, v, EAR_OUTLINE)
    deep = smoothstep(1.3, 0.8, np.hypot((u - 4.2) / 9, (v - 1) / 13))
    front = smoothstep(-3, -8, u)
    return w - (3.4 + 1.6 * smoothstep(-7, -2, outline) - 14.0 * deep - 16.0 * front)


def split_along(vertices, faces, value_of, allowed, locked):
    """Cut every triangle that the zero line of `value_of` crosses; vertices close to it are moved onto it.

    `allowed` and `locked` are masks: only edges between allowed vertices are cut, locked vertices do not move.
    Returns the new vertices and faces; the first rows of the vertices are the old ones.
    """
    vertices = vertices.copy()
    edges, owner = unique_edges(faces)
    value = value_of(vertices)
    # Snap: the endpoint of a crossed edge moves to the crossing if that is within 30 % of the edge
    crossed = allowed[edges].all(1) & (value[edges[:, 0]] * value[edges[:, 1]] < 0)
    a, b = edges[crossed].T
    t = value[a] / (value[a] - value[b])
    near = np.concatenate([a[(t < 0.3) & ~locked[a]], b[(t > 0.7) & ~locked[b]]])
    to = np.concatenate([b[(t < 0.3) & ~locked[a]], a[(t > 0.7) & ~locked[b]]])
    part = np.concatenate([t[(t < 0.3) & ~locked[a]], 1 - t[(t > 0.7) & ~locked[b]]])
    order = np.argsort(part, kind="stable")
    near, to, part = near[order], to[order], part[order]
    corner = np.argsort(faces.ravel(), kind="stable")
    start = np.searchsorted(faces.ravel()[corner], np.arange(len(vertices) + 1))
    on_line = value == 0
    for v, other, share in zip(near, to, part, strict=True):
        ring = faces[corner[start[v] : start[v + 1]] // 3]
        if on_line[v] or (on_line[ring].sum(1) == 2).any():  # would leave a triangle without area
            continue
        vertices[v] += share * (vertices[other] - vertices[v])
        on_line[v] = True
    value[on_line] = 0.0
    # Split what is still crossed
    crossed = allowed[edges].all(1) & (value[edges[:, 0]] * value[edges[:, 1]] < 0)
    a, b = edges[crossed].T
    t = np.clip(value[a] / (value[a] - value[b]), 0.05, 0.95)
    middle = np.full(len(edges), -1)
    middle[crossed] = len(vertices) + np.arange(crossed.sum())
    vertices = np.vstack([vertices, vertices[a] + t[:, None] * (vertices[b] - vertices[a])])
    mid = middle[owner]  # (F, 3): new vertex on edge k (from corner k to k + 1), or -1
    count = (mid >= 0).sum(1)
    out = [faces[count == 0]]
    one = count == 1
    k = mid[one].argmax(1)
    f, m = faces[one], mid[one].max(1)
    i = np.arange(len(f))
    c0, c1, c2 = f[i, k], f[i, (k + 1) % 3], f[i, (k + 2) % 3]
    out += [np.stack([c0, m, c2], 1), np.stack([m, c1, c2], 1)]
    two = count == 2
    k = (mid[two].argmin(1) + 2) % 3  # the corner between the two cut edges follows the whole edge's end
    f, g = faces[two], mid[two]
    i = np.arange(len(f))
    apex, n1, n2 = f[i, k], f[i, (k + 1) % 3], f[i, (k + 2) % 3]
    m1, m2 = g[i, k], g[i, (k + 2) % 3]
    out += [np.stack([apex, m1, m2], 1), np.stack([m1, n1, n2], 1), np.stack([m1, n2, m2], 1)]
    return vertices, np.vstack(out)


def unique_edges(faces):
    """Edges (E, 2) and, for each face, the edge from corner k to corner k + 1, shape (F, 3)."""
    half = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2)
    edges, inverse = np.unique(np.sort(half, axis=1), axis=0, return_inverse=True)
    return edges, inverse.reshape(-1, 3)


def cut_into_charts(vertices, faces):
    """Split along all seams and label the faces.

    Returns vertices, faces, the chart label of each face, and the set of seam edges as a mask over `unique_edges`.
    """
    n = lambda v: np.zeros(len(v), bool)  # noqa: E731
    vertices, faces = split_along(vertices, faces, lambda p: p[:, 1] - (NECK_CUT_Y + 0.9), ~n(vertices), n(vertices))
    vertices, faces = split_along(vertices, faces, ear_value, np.abs(vertices[:, 0]) > 50, n(vertices))
    e = ear_value(vertices)
    vertices, faces = split_along(vertices, faces, rim_value, e > -0.05, np.abs(e) < 0.05)
    back = (vertices[:, 2] < BACK_SEAM_FRONT + 4) & (np.abs(vertices[:, 0]) < 20)
    vertices, faces = split_along(vertices, faces, lambda p: p[:, 0], back, vertices[:, 1] < NECK_CUT_Y + 1.0)
    label = label_faces(vertices, faces)
    edges, owner = unique_edges(faces)
    low = np.full(len(edges), 99)
    high = np.full(len(edges), -1)
    np.minimum.at(low, owner.ravel(), np.repeat(label, 3))
    np.maximum.at(high, owner.ravel(), np.repeat(label, 3))
    p, q = vertices[edges[:, 0]], vertices[edges[:, 1]]
    on_back = (np.abs(p[:, 0]) < 1e-6) & (np.abs(q[:, 0]) < 1e-6)
    on_back &= (p[:, 2] < BACK_SEAM_FRONT) & (q[:, 2] < BACK_SEAM_FRONT) & (low == HEAD) & (high == HEAD)
    return vertices, faces, label, (low != high) | on_back


def label_faces(vertices, faces):
    """Chart label of each face; specks that are not connected to their chart join a neighbour."""
    mean = lambda value: value[faces].mean(1)  # noqa: E731
    right = (vertices[faces, 0].mean(1) < 0).astype(int)
    label = np.where(mean(rim_value(vertices)) > 0, EAR_FRONT, EAR_BACK) + right
    label[mean(ear_value(vertices)) <= 0] = HEAD
    label[mean(vertices[:, 1]) < NECK_CUT_Y + 0.9] = CAP
    edges, owner = unique_edges(faces)
    for _ in range(40):
        pair = face_pairs(owner, len(edges))
        same = pair[label[pair[:, 0]] == label[pair[:, 1]]]
        piece = connected_components(coo_matrix((np.ones(len(same)), same.T), (len(faces),) * 2), directed=False)[1]
        size = np.bincount(piece)
        biggest = {c: size[piece[label == c]].max() for c in np.unique(label)}
        speck = size[piece] < np.array([biggest[c] for c in label])
        if not speck.any():
            break
        a, b = pair[speck[pair[:, 0]] & ~speck[pair[:, 1]]].T
        c, d = pair[speck[pair[:, 1]] & ~speck[pair[:, 0]]].T
        new = label.copy()
        new[a], new[d] = label[b], label[c]
        label = new
    return label


def face_pairs(owner, n_edges):
    """Pairs of faces that share an edge, shape (K, 2)."""
    order = np.argsort(owner.ravel(), kind="stable")
    count = np.bincount(owner.ravel(), minlength=n_edges)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    full = start[count == 2]
    return np.stack([order[full], order[full + 1]], 1) // 3


def texture_vertices(faces, seam):
    """Index of the texture vertex at each corner, shape (F, 3): corners that meet without a seam share one."""
    edges, owner = unique_edges(faces)
    n = faces.size
    order = np.argsort(owner.ravel(), kind="stable")
    count = np.bincount(owner.ravel(), minlength=len(edges))
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    whole = start[(count == 2) & ~seam]
    a, b = order[whole], order[whole + 1]  # half edges: corner k to k + 1 of a face, opposite ways round
    following = lambda h: h - h % 3 + (h + 1) % 3  # noqa: E731
    link = np.concatenate([np.stack([a, following(b)], 1), np.stack([following(a), b], 1)])
    label = connected_components(coo_matrix((np.ones(len(link)), link.T), (n, n)), directed=False)[1]
    return label.reshape(-1, 3)
