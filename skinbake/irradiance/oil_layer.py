"""Bounds and units of the oil layer: Kelemen/Szirmay-Kalos specular over a Beckmann distribution, theory.md 6.

`roughness` is Beckmann m, `strength` is rho_s. The distribution carries no 1/pi, so `ENERGY_TRUE_STRENGTH` = 1/pi is
the strength that conserves energy and rho_s = 1 reflects pi times too much (theory.md 6.1).
"""

from __future__ import annotations

import numpy as np

ENERGY_TRUE_STRENGTH = 1 / np.pi
ROUGHNESS_MIN = 1e-4
HALF_SQUARED_MIN = 1e-6  # h.h reaches 0 only for L = -V, both grazing (theory.md 6.7)
