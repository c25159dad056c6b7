"""Write the mesh as Wavefront OBJ."""

import numpy as np


def write_obj(path, vertices, uv, normals, faces, corner_uv):
    """One shared `v` and `vn` a vertex, `vt` split at the seams; 1e-3 mm, 1e-6 in UV."""
    lines = [
        "# skinbake sample head: millimetres, y up, face toward +z, x to the head's left",
        "# our own work, MIT",
        "o head",
    ]
    lines += [f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in vertices]
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in uv]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in normals]
    lines += [
        f"f {a}/{s}/{a} {b}/{t}/{b} {c}/{r}/{c}"
        for (a, b, c), (s, t, r) in zip((faces + 1).tolist(), (np.asarray(corner_uv) + 1).tolist(), strict=True)
    ]
    text = "\n".join(lines).replace(" -0.000 ", " 0.000 ") + "\n"
    path.write_bytes(text.encode())
