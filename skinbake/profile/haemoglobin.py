"""Absorption of blood: molar extinction of oxygenated and deoxygenated haemoglobin."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float

# Every 10 nm of the table that Scott Prahl compiled from measurements of W. B. Gratzer (Medical Research Council Labs,
# London) and N. Kollias (Wellman Laboratories, Harvard): "Tabulated Molar Extinction Coefficient for Hemoglobin in
# Water", Oregon Medical Laser Center, 1998 [Prahl1998]. Columns: wavelength nm, HbO2, Hb; unit 1/cm per mol/l, decadic.
_TABLE = np.array(
    [
        [380, 109564, 145232],
        [390, 167748, 167780],
        [400, 266232, 223296],
        [410, 466840, 303956],
        [420, 480360, 407560],
        [430, 246072, 528600],
        [440, 102580, 413280],
        [450, 62816, 103292],
        [460, 44480, 23388.8],
        [470, 33209.2, 16156.4],
        [480, 26629.2, 14550],
        [490, 23684.4, 16684],
        [500, 20932.8, 20862],
        [510, 20035.2, 25773.6],
        [520, 24202.4, 31589.6],
        [530, 39956.8, 39036.4],
        [540, 53236, 46592],
        [550, 43016, 53412],
        [560, 32613.2, 53788],
        [570, 44496, 45072],
        [580, 50104, 37020],
        [590, 14400.8, 28324.4],
        [600, 3200, 14677.2],
        [610, 1506, 9443.6],
        [620, 942, 6509.6],
        [630, 610, 5148.8],
        [640, 442, 4345.2],
        [650, 368, 3750.12],
        [660, 319.6, 3226.56],
        [670, 294, 2795.12],
        [680, 277.6, 2407.92],
        [690, 276, 2051.96],
        [700, 290, 1794.28],
        [710, 314, 1540.48],
        [720, 348, 1325.88],
        [730, 390, 1102.2],
        [740, 446, 1115.88],
        [750, 518, 1405.24],
        [760, 586, 1548.52],
        [770, 650, 1311.88],
        [780, 710, 1075.44],
    ]
)

GRAMS_PER_LITRE = 150.0  # haemoglobin in whole blood
GRAMS_PER_MOLE = 64_500.0


def blood_absorption_per_mm(wavelength_nm: Float) -> tuple[Float, Float]:
    """Absorption of fully oxygenated and fully deoxygenated whole blood, 1/mm, each of the shape of the wavelengths.

    Raises
    ------
    ValueError
        If a wavelength lies outside the table, 380 to 780 nm.

    References
    ----------
    [Prahl1998], [Donner2006]
    """
    if np.min(wavelength_nm) < _TABLE[0, 0] or np.max(wavelength_nm) > _TABLE[-1, 0]:
        raise ValueError(f"wavelength_nm: expected 380 to 780, got {np.min(wavelength_nm)} to {np.max(wavelength_nm)}")
    # ln 10: decadic to natural; / 10: 1/cm to 1/mm
    scale = np.log(10) * GRAMS_PER_LITRE / GRAMS_PER_MOLE / 10
    oxygenated = scale * np.interp(wavelength_nm, _TABLE[:, 0], _TABLE[:, 1])
    return oxygenated, scale * np.interp(wavelength_nm, _TABLE[:, 0], _TABLE[:, 2])
