"""Draws skinbake/docs/directions.svg: axes, and which way lights and skies face. `python data/draw_directions.py`"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.irradiance.environment_map import direction_of
from skinbake.preview.camera import Camera

OUT = Path(__file__).parents[1] / "skinbake" / "docs" / "directions.svg"
WIDTH, HEIGHT, SCALE = 400, 300, 0.7
RED, GREEN, BLUE, INK, LIGHT = "#c0392b", "#1e8449", "#2155a8", "#333", "#c98a00"
RADII = np.array([75.0, 110.0, 92.0])  # of the head, mm
AXES = Camera(np.zeros(3), 1.0, -30.0, 18.0).pose[:3, :3]
FONT = "font-family='sans-serif' font-size='13'"


class Panel:
    """One of the four pictures: points in mm are seen from the head's right, a little from above."""

    def __init__(self, column, row, title, share=0.4):
        self.middle = np.array([(column + share) * WIDTH, (row + 0.56) * HEIGHT])
        self.parts = []
        self.text((column * WIDTH + 14, row * HEIGHT + 24), title, bold=True)

    def at(self, point):
        seen = np.asarray(point, float) @ AXES
        return self.middle + SCALE * seen[:2] * [1, -1]

    def text(self, where, words, colour=INK, anchor="start", bold=False):
        weight = " font-weight='bold'" if bold else ""
        self.parts.append(
            f"<text x='{where[0]:.1f}' y='{where[1]:.1f}' fill='{colour}' text-anchor='{anchor}'{weight}>{words}</text>"
        )

    def label(self, point, words, colour=INK, anchor="start", shift=(0, 0)):
        self.text(self.at(point) + shift, words, colour, anchor)

    def line(self, points, colour, width=1.5, fill="none", dash=""):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self.at, points))
        self.parts.append(
            f"<polyline points='{path}' fill='{fill}' stroke='{colour}' stroke-width='{width}'"
            f" stroke-linejoin='round'{f' stroke-dasharray={dash!r}' if dash else ''}/>"
        )

    def arrow(self, start, end, colour, width=2.4):
        a, b = self.at(start), self.at(end)
        along = (b - a) / np.linalg.norm(b - a)
        across = np.array([-along[1], along[0]])
        self.line([start, end], colour, width)
        tip = " ".join(
            f"{x:.1f},{y:.1f}" for x, y in (b + 3 * along, b - 9 * along + 5 * across, b - 9 * along - 5 * across)
        )
        self.parts.append(f"<polygon points='{tip}' fill='{colour}'/>")

    def dot(self, point, colour):
        x, y = self.at(point)
        self.parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='4' fill='{colour}'/>")

    def head(self):
        """An ellipsoid with eyes and a nose."""
        around = np.linspace(0, 2 * np.pi, 60)
        ring = np.stack([np.cos(around), np.sin(around)], axis=1)
        # The outline of an ellipsoid: where its normal is across the view
        view = (AXES.T * RADII)[2]
        basis = np.linalg.svd(view[None])[2][1:]
        self.line(RADII * (ring @ basis), "#8a6d5a", 1.4, "#ecd3c2")
        for side in (-1, 1):
            self.dot((side * 30, 22, 84), "#5b4636")
        self.line([(0, 18, 91), (0, -16, 112), (0, -22, 88)], "#8a6d5a", 2)
        self.line([(-22, -52, 74), (0, -56, 80), (22, -52, 74)], "#a05252", 2)


def axes():
    panel = Panel(0, 0, "Axes")
    panel.head()
    for end, colour, words, shift in (
        ((150, 0, 0), RED, "+x, its left", (8, 0)),
        ((0, 175, 0), GREEN, "+y, up", (8, 4)),
        ((0, 0, 215), BLUE, "+z, where it looks", (-20, 24)),
    ):
        start = np.array(end) * RADII / np.linalg.norm(end)
        panel.arrow(start, end, colour)
        panel.label(end, words, colour, shift=shift)
    return panel


def direction():
    panel = Panel(1, 0, "direction: where light travels to")
    panel.head()
    along = np.array([-0.62, -0.5, -0.6]) / np.linalg.norm([0.62, 0.5, 0.6])
    across = np.array([[0, 0, 0], [45, -37, 0], [-40, 48, 0]])
    for shift in across:
        panel.arrow(shift - 260 * along, shift - 135 * along, LIGHT)
    panel.label(-260 * along, "[-0.62, -0.5, -0.6]", LIGHT, "middle", (10, -42))
    panel.label((0, -150, 0), "from its left, from above, from the front", INK, "middle", (10, 16))
    return panel


def rectangle():
    panel = Panel(0, 1, "rectangle: along cross(edge_u_mm, edge_v_mm)")
    panel.head()
    middle = np.array([130.0, 50.0, 190.0])
    to_head = -middle / np.linalg.norm(middle)
    v = np.array([0.0, 1.0, 0.0]) - to_head[1] * to_head
    v /= np.linalg.norm(v)
    u = np.cross(v, to_head)  # so that cross(u, v) points at the head
    assert np.cross(u, v) @ to_head > 0.99
    corner = middle - 45 * u - 45 * v
    panel.line([corner, corner + 90 * u, corner + 90 * (u + v), corner + 90 * v, corner], LIGHT, 1.5, "#ffe9b0")
    panel.arrow(corner, corner + 90 * u, RED)
    panel.arrow(corner, corner + 90 * v, GREEN)
    panel.arrow(middle, middle + 80 * to_head, LIGHT)
    panel.label(corner + 90 * u, "edge_u_mm", RED, "start", (-20, 22))
    panel.label(corner + 90 * v, "edge_v_mm", GREEN, "middle", (0, -10))
    return panel


def sky():
    panel = Panel(1, 1, "environment: middle of the picture at +z", 0.46)
    ring = [150 * direction_of(u, 0.5) for u in np.linspace(0, 1, 61)]
    panel.line(ring[50:-1] + ring[:11], LIGHT, 1.4, dash="4 3")  # what the head hides
    panel.head()
    panel.line(ring[10:51], LIGHT, 1.4, dash="4 3")
    for u, words, anchor, shift in (
        (0.5, "u 0.5, before it", "middle", (24, 22)),
        (0.25, "u 0.25, its left", "start", (10, 4)),
        (0.75, "u 0.75, right", "end", (-8, 18)),
        (0.0, "u 0 and 1, behind", "end", (-4, -10)),
    ):
        point = 150 * direction_of(u, 0.5)
        panel.dot(point, LIGHT)
        panel.label(point, words, LIGHT, anchor, shift)
    turn = [175 * direction_of(0.5, 0.5, degrees) for degrees in np.linspace(4, 40, 12)]
    panel.line(turn[:-1], BLUE, 2)
    panel.arrow(turn[-2], turn[-1], BLUE)
    panel.label(turn[-1], "rotate_deg", BLUE, "start", (8, 12))
    panel.label((0, 140, 0), "top row: up", LIGHT, "middle", (0, -6))
    return panel


def drawing():
    """The whole picture as text."""
    parts = [part for panel in (axes(), direction(), rectangle(), sky()) for part in panel.parts]
    size = f"width='{2 * WIDTH}' height='{2 * HEIGHT}' viewBox='0 0 {2 * WIDTH} {2 * HEIGHT}'"
    lines = f"M{WIDTH},0V{2 * HEIGHT}M0,{HEIGHT}H{2 * WIDTH}"
    head = [f"<svg xmlns='http://www.w3.org/2000/svg' {size} {FONT}>", "<rect width='100%' height='100%' fill='#fff'/>"]
    return "\n".join([*head, f"<path d='{lines}' stroke='#ddd'/>", *parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    OUT.write_text(drawing(), encoding="utf-8")
