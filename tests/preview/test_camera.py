"""Named views show what their names say, whole, from outside."""

from typing import get_args

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.preview.camera import ANGLES, VIEWS, Camera, turntable, view
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.output import View
from tests.shapes import joined, quad, sphere


def projected(mesh, camera, aspect):
    """Frame coordinates of every vertex, -1 ... 1 in both axes inside the frame."""
    seen = (mesh.positions_mm - camera.position_mm) @ camera.pose[:3, :3]
    assert (seen[:, 2] < 0).all()  # before the camera
    slope = np.tan(np.radians(camera.yfov_deg) / 2)
    return seen[:, :2] / -seen[:, 2:] / slope / [aspect, 1]


@pytest.mark.parametrize("name", list(ANGLES))
@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.3])
def test_whole_views_hold_every_vertex_and_fill_the_frame(name, aspect):
    mesh = sphere(90.0)
    frame = projected(mesh, view(mesh, name, aspect), aspect)
    assert np.abs(frame).max() <= 1.0
    assert np.abs(frame).max() > 0.8


@pytest.mark.parametrize("aspect", [0.6, 1.7])
def test_a_turntable_holds_a_long_head_in_every_frame_at_one_distance(aspect):
    ball = sphere(90.0)
    head = SkinMesh(ball.positions_mm * [0.8, 1.2, 1.1] + [3, 9, 20], ball.faces, ball.corner_uv, ball.corner_normal)
    cameras = turntable(head, "three-quarter", aspect, 7)
    frames = [np.abs(projected(head, camera, aspect)).max() for camera in cameras]
    assert max(frames) <= 1.0
    assert max(frames) > 0.85
    assert len({camera.distance_mm for camera in cameras}) == 1
    assert len({camera.azimuth_deg for camera in cameras}) == 7


def test_a_look_may_ask_for_every_view_and_no_other():
    assert set(get_args(View)) == set(VIEWS)


def test_left_is_the_heads_own_left_and_front_its_face():
    mesh = sphere(90.0)
    np.testing.assert_allclose(view(mesh, "front", 1.0).backward, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(view(mesh, "left", 1.0).backward, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(view(mesh, "back", 1.0).backward, [0, 0, -1], atol=1e-12)


def test_the_pose_is_a_rotation_that_looks_at_its_target():
    camera = Camera(np.array([3.0, -5.0, 7.0]), 400.0, 33.0, -12.0)
    pose = camera.pose
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(pose[:3, 3] - 400 * pose[:3, 2], camera.target_mm, atol=1e-9)
    assert pose[1, 1] > 0  # upright


def test_close_ups_stand_before_the_nose_and_the_ear():
    nose, ear = quad(4, 4, z_mm=0), quad(4, 4, z_mm=0)
    head = sphere(95.0)
    nose = SkinMesh(nose.positions_mm + np.array([0, -5, 118]), nose.faces, nose.corner_uv, nose.corner_normal)
    ear = SkinMesh(ear.positions_mm + np.array([104, 10, -4]), ear.faces, ear.corner_uv, ear.corner_normal)
    mesh = joined(head, nose, ear)
    for name, point in (("nose", [0, -5, 118]), ("ear", [104, 10, -4])):
        camera = view(mesh, name, 0.8)
        seen = (np.array(point) - camera.position_mm) @ camera.pose[:3, :3]
        slope = np.tan(np.radians(camera.yfov_deg) / 2)
        assert np.abs(seen[:2] / -seen[2] / slope / [0.8, 1]).max() < 0.6
        assert 100 < camera.distance_mm < 600


def test_a_busts_shoulders_do_not_make_the_face_small():
    head = sphere(100.0)
    shoulders = quad(500.0, 100.0)
    shoulders = SkinMesh(
        shoulders.positions_mm - [0, 230, 0], shoulders.faces, shoulders.corner_uv, shoulders.corner_normal
    )
    bust = joined(head, shoulders)
    assert view(bust, "front", 0.8).distance_mm < 1.35 * view(head, "front", 0.8).distance_mm


def test_moves_stay_finite_and_upright():
    camera = view(sphere(90.0), "front", 1.0).turned(500, 1000).zoomed(1e-30).panned(2, 2)
    assert camera.elevation_deg == 89
    assert np.isfinite(camera.pose).all()


def test_an_unknown_view_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=", ".join(VIEWS) + ", got top"):
        view(sphere(90.0), "top", 1.0)
