"""Flatten the charts: a conformal start, then the symmetric Dirichlet energy by reweighted least squares.

References
----------
[Levy2002] Least squares conformal maps. [Rabinovich2017] Scalable locally injective mappings.
"""

import numpy as np
from scipy.sparse import bmat, coo_matrix, diags, identity
from scipy.sparse.linalg import splu

from sample_head.charts import CAP, EAR_BACK, EAR_FRONT, HEAD

MARGIN = 0.006  # free border of the unit square
EAR_SCALE = 1.1  # texels for the ears, against the rest


def flat_triangles(points, faces):
    """Each triangle laid flat: its edge vectors from corner 0 as columns, shape (F, 2, 2), and its area.

    Slivers are laid a little fatter than they are, or round-off would turn them over.
    """
    e1, e2 = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    length = np.linalg.norm(e1, axis=1)
    x2 = (e1 * e2).sum(1) / length
    y2 = np.linalg.norm(np.cross(e1, e2), axis=1) / length
    y2 = np.maximum(y2, 0.1 * np.maximum(length, np.hypot(x2, y2)))
    edge = np.zeros((len(faces), 2, 2))
    edge[:, 0, 0], edge[:, 0, 1], edge[:, 1, 1] = length, x2, y2
    return edge, 0.5 * length * y2


def gradient_operators(points, faces, n):
    """Sparse (F, n) matrices that give d/ds and d/dt of a function at the corners, in the flat triangles."""
    edge, area = flat_triangles(points, faces)
    inverse = np.linalg.inv(edge)
    row = np.repeat(np.arange(len(faces)), 3)
    out = []
    for axis in range(2):
        c1, c2 = inverse[:, 0, axis], inverse[:, 1, axis]
        out.append(coo_matrix((np.stack([-c1 - c2, c1, c2], 1).ravel(), (row, faces.ravel())), (len(faces), n)).tocsr())
    return out[0], out[1], area


def solve(matrix, right):
    """Sparse symmetric positive definite solve."""
    factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.solve(right)


def conformal(points, faces, pins):
    """Least squares conformal map; `pins` are two texture vertices held at (0, 0) and (0, 1)."""
    n = int(faces.max()) + 1
    gs, gt, area = gradient_operators(points, faces, n)
    weight = np.sqrt(area)[:, None]
    ws, wt = gs.multiply(weight).tocsr(), gt.multiply(weight).tocsr()
    a = bmat([[ws, -wt], [wt, ws]]).tocsr()
    known = np.array([pins[0], pins[1], n + pins[0], n + pins[1]])
    fixed = np.array([0.0, 0.0, 0.0, 1.0])
    free = np.setdiff1d(np.arange(2 * n), known)
    left = a[:, free]
    right = -(a[:, known] @ fixed)
    uv = np.zeros(2 * n)
    uv[known] = fixed
    uv[free] = solve(left.T @ left, left.T @ right)
    return uv.reshape(2, n).T


def border_loops(faces):
    """Closed loops of border vertices, each in the order of the faces' turn."""
    half = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2).tolist()
    present = set(map(tuple, half))
    after = {a: b for a, b in half if (b, a) not in present}
    loops = []
    while after:
        ring = [min(after)]
        while after[ring[-1]] != ring[0]:
            ring.append(after[ring[-1]])
        for v in ring:
            del after[v]
        loops.append(np.array(ring))
    return loops


def even_out(faces, uv, flipped, rings):
    """Put the inner vertices around flipped triangles at the mean of their neighbours, a few rings deep."""
    n = len(uv)
    half = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2)
    link = coo_matrix((np.ones(len(half)), half.T), (n, n)).tocsr()
    link = ((link + link.T) > 0).astype(float)
    move = np.zeros(n, bool)
    move[faces[flipped]] = True
    for _ in range(rings):
        move |= (link @ move.astype(float)) > 0
    for ring in border_loops(faces):
        move[ring] = False
    free, held = np.flatnonzero(move), np.flatnonzero(~move)
    laplace = (diags(np.asarray(link.sum(1)).ravel()) - link).tocsr()[free]
    uv = uv.copy()
    if not len(free):
        return uv
    uv[free] = solve(laplace[:, free], -(laplace[:, held] @ uv[held]))
    return uv


def on_a_disc(points, faces):
    """Convex-combination map of a disc-like chart, its border on a circle: never flips, but stretches."""
    n = len(points)
    half = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2)
    ring = max(border_loops(faces), key=len)
    step = np.linalg.norm(points[ring] - points[np.roll(ring, -1)], axis=1)
    angle = 2 * np.pi * np.concatenate([[0], np.cumsum(step)[:-1]]) / step.sum()
    uv = np.zeros((n, 2))
    uv[ring] = np.stack([np.cos(angle), np.sin(angle)], 1)
    link = coo_matrix((np.ones(len(half)), half.T), (n, n)).tocsr()
    link = ((link + link.T) > 0).astype(float)
    laplace = (diags(np.asarray(link.sum(1)).ravel()) - link).tocsr()
    free = np.setdiff1d(np.arange(n), ring)
    uv[free] = solve(laplace[free][:, free], -(laplace[free][:, ring] @ uv[ring]))
    return uv


def flatten(points, faces, pins, rounds):
    """Flip-free low-stretch map of one chart, in mm; returns it and its energy (4 is an isometry)."""
    uv = conformal(points, faces, pins)
    gs, gt, _ = gradient_operators(points, faces, len(points))
    flipped = np.linalg.det(jacobians(uv, gs, gt)) <= 0
    for rings in range(1, 7):
        if not flipped.any():
            break
        uv = even_out(faces, uv, flipped, rings)
        flipped = np.linalg.det(jacobians(uv, gs, gt)) <= 0
    else:
        uv = on_a_disc(points, faces)
    return relax(points, faces, uv, rounds)


def jacobians(uv, gs, gt):
    """d(u, v)/d(s, t) of each triangle, shape (F, 2, 2)."""
    return np.stack([gs @ uv, gt @ uv], -1)


def energy(jacobian, area):
    """Symmetric Dirichlet energy, infinite if a triangle is flipped."""
    det = np.linalg.det(jacobian)
    if (det <= 0).any():
        return np.inf
    square = (jacobian**2).sum((1, 2))
    return float((area * square * (1 + 1 / det**2)).sum() / area.sum())


def relax(points, faces, uv, rounds):
    """Lower the stretch of a flip-free map, keeping it flip-free."""
    n = len(uv)
    gs, gt, area = gradient_operators(points, faces, n)
    jac = jacobians(uv, gs, gt)
    uv = uv / np.sqrt(np.average(np.linalg.det(jac), weights=area))
    uv = uv - uv.mean(0)
    now = energy(jacobians(uv, gs, gt), area)
    for _ in range(rounds):
        jac = jacobians(uv, gs, gt)
        # Weights and target rotation per triangle, table 2 and eq. 14 of [Rabinovich2017]
        left, sigma, right = np.linalg.svd(jac)
        slope = sigma - sigma**-3
        near_one = np.abs(sigma - 1) < 1e-4
        scale = np.sqrt(np.where(near_one, 4.0, slope / np.where(near_one, 1.0, sigma - 1)))
        metric = left @ (scale[:, :, None] * np.swapaxes(left, 1, 2))
        target = left @ right
        rows, rights = [], []
        root = np.sqrt(area)
        for i in range(2):
            w0, w1 = metric[:, i, 0] * root, metric[:, i, 1] * root
            for axis, g in ((0, gs), (1, gt)):
                rows.append([g.multiply(w0[:, None]), g.multiply(w1[:, None])])
                rights.append(w0 * target[:, 0, axis] + w1 * target[:, 1, axis])
            a = bmat(rows).tocsr()
        normal = a.T @ a
        tiny = 1e-6 * normal.diagonal().mean()
        aim = solve(normal + tiny * identity(2 * n), a.T @ np.concatenate(rights) + tiny * uv.T.ravel())
        step = aim.reshape(2, n).T - uv
        size = 1.0
        while size > 1e-4:
            trial = uv + size * step
            value = energy(jacobians(trial, gs, gt), area)
            if value < now:
                break
            size *= 0.6
        else:
            break
        gain, uv, now = now - value, trial, value
        if gain < 1e-4 * now:
            break
    return uv, now


def turn_upright(points, uv):
    """Rotate a chart so that the head's up is +v (least squares over the chart)."""
    centred = uv - uv.mean(0)
    slope = np.linalg.lstsq(centred, points[:, 1] - points[:, 1].mean(), rcond=None)[0]
    up = slope / np.linalg.norm(slope)
    return centred @ np.array([[up[1], up[0]], [-up[0], up[1]]])


def lay_out(points, faces, label, corner, rounds=30):
    """UV of every texture vertex in the unit square, shape (T, 2), v up.

    The head lies upright across the top; ears and the neck's cap stand in a row below it.
    """
    n = int(corner.max()) + 1
    place = np.zeros((n, 3))
    place[corner.ravel()] = points[faces.ravel()]
    flat = {}
    for chart in np.unique(label):
        ids, local = np.unique(corner[label == chart], return_inverse=True)
        p, f = place[ids], local.reshape(-1, 3)
        axis = 2 if chart == CAP else 1
        near = np.flatnonzero((np.abs(p[:, 0]) < 3) & (p[:, 2] > 50)) if chart == HEAD else np.arange(len(p))
        pins = near[p[near, axis].argmin()], near[p[near, axis].argmax()]
        uv, _ = flatten(p, f, pins, rounds)
        upright = p[:, [0, 2, 1]] if chart == CAP else p
        uv = turn_upright(upright, uv) * (EAR_SCALE if chart >= EAR_FRONT else 1.0)
        flat[chart] = ids, uv - uv.min(0)
    width = np.ptp(flat[HEAD][1], axis=0)[0]
    side = width / (1 - 2 * MARGIN)
    row = [EAR_FRONT + 1, EAR_BACK + 1, CAP, EAR_BACK, EAR_FRONT]
    sizes = [np.ptp(flat[c][1], axis=0)[0] for c in row]
    gap = (width - sum(sizes)) / (len(row) - 1)
    out = np.zeros((n, 2))
    ids, uv = flat[HEAD]
    out[ids] = uv / side + [MARGIN, 1 - MARGIN - np.ptp(uv, axis=0)[1] / side]
    x = MARGIN * side
    for chart, size in zip(row, sizes, strict=True):
        ids, uv = flat[chart]
        out[ids] = (uv + np.array([x, MARGIN * side])) / side
        x += size + gap
    return out
