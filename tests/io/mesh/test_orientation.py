"""A head that lies down, or looks elsewhere, is told from one that stands with its face along z."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.io.mesh import guess_orientation, read_mesh
from tests.conftest import ROOT
from tests.shapes import quad, sphere

TURNS = {
    "as it should": (np.eye(3), None),
    "z up": (np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "set mesh.up: z"),
    "backwards": (np.diag([-1.0, 1, -1]), "set mesh.front: -z"),
    "along x": (np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), "set mesh.front: x"),
    "along -x": (np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]), "set mesh.front: -x"),
    "on its side": (np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), "turn it"),
}


def head():
    """An egg with a wrinkled front and an open neck."""
    ball = sphere(100.0, "cube", 48)
    p = ball.positions_mm
    front = np.clip(p[:, 2:] / 100 - 0.3, 0, 1)
    bumps = 1 + 0.5 * front * np.cos(6 * np.pi * p[:, :1] / 100) * np.cos(5 * np.pi * p[:, 1:2] / 100) * 0.2
    positions = p * bumps * [0.75, 1.25, 0.95]
    keep = positions[ball.faces].mean(axis=1)[:, 1] > -105
    bent = replace(ball, positions_mm=positions, faces=ball.faces[keep], corner_uv=ball.corner_uv[keep],
                   corner_normal=ball.corner_normal[keep])  # fmt: skip
    return replace(bent, corner_normal=np.repeat(bent.face_normal[:, None], 3, axis=1))


def turned(mesh, turn):
    return replace(
        mesh, positions_mm=mesh.positions_mm @ turn.T + [9, -40, 3], corner_normal=mesh.corner_normal @ turn.T
    )


@pytest.mark.parametrize("case", TURNS)
def test_each_way_a_head_can_lie(case):
    """With the key that mends it, and none where nothing is wrong."""
    turn, advice = TURNS[case]
    found = guess_orientation(turned(head(), turn))
    if advice is None:
        assert (found.lateral, found.crown, found.face, found.advice) == ("x", "+y", "+z", None)
    else:
        assert advice in found.advice
    crown, face = turn @ [0, 1, 0], turn @ [0, 0, 1]
    for said, direction in ((found.crown, crown), (found.face, face)):
        assert said == ("+" if direction.sum() > 0 else "-") + "xyz"[int(np.argmax(np.abs(direction)))]


def test_what_gives_no_sign_gives_no_advice():
    """A ball and a plane: nothing is guessed."""
    for mesh in (sphere(100.0, "cube", 16), quad(200.0, 200.0, columns=8, rows=8)):
        assert guess_orientation(mesh).advice is None


@pytest.mark.parametrize("case", ["as it should", "z up"])
def test_the_sample_head(case):
    """Closed, with ears and a neck: its crown is found, and that it lies."""
    turn, advice = TURNS[case]
    found = guess_orientation(turned(read_mesh(ROOT / "data" / "head.obj", 1.0), turn))
    assert found.lateral == "x"
    assert found.advice is None if advice is None else advice in found.advice
