import numpy as np
import pytest

from skinbake.profile import fit_skin, profile_of
from skinbake.profile.haemoglobin import blood_absorption_per_mm
from skinbake.profile.physiology import (
    baseline_absorption_per_mm,
    dermis_absorption_per_mm,
    epidermis_absorption_per_mm,
    epidermis_scattering_per_mm,
    melanin_absorption_per_mm,
)
from skinbake.profile.spectrum import D65, WAVELENGTH_NM, colour_matching, reflectance_to_rgb
from skinbake.scene.skin import PhysiologySkin


def skin(**keys):
    return PhysiologySkin(model="physiology", **keys)


def test_white_is_white():
    """The fitted functions under D65 give its white within 0.2 %, and a white reflector is exactly (1, 1, 1)."""
    xyz = colour_matching(WAVELENGTH_NM) @ D65
    np.testing.assert_allclose(xyz / xyz[1], [0.9505, 1, 1.0888], rtol=2e-3)
    np.testing.assert_allclose(reflectance_to_rgb() @ np.ones(len(WAVELENGTH_NM)), 1, rtol=1e-14)


def test_narrow_bands_have_their_colour():
    """A reflector of long waves is red, of middle ones green, of short ones blue."""
    bands = [(600, 700), (510, 570), (420, 480)]
    light = np.array([(low <= WAVELENGTH_NM) & (high >= WAVELENGTH_NM) for low, high in bands], float)
    assert (reflectance_to_rgb() @ light.T).argmax(axis=0).tolist() == [0, 1, 2]


def test_blood_has_its_bands():
    """Oxygenated blood absorbs most near 420 nm, has two bands at 540 and 580 nm with a gap at 560, and little red."""
    oxygenated, deoxygenated = blood_absorption_per_mm(WAVELENGTH_NM)
    at = dict(zip(WAVELENGTH_NM, oxygenated, strict=True))
    assert max(at, key=at.get) == 420
    assert at[540] > at[560] < at[580]
    assert at[660] < 0.01 * at[540]
    # pure blood at 540 nm: ln 10 * 53236 / (cm mol/l) * 150 g/l / 64500 g/mol = 285 /cm
    assert at[540] == pytest.approx(28.5, rel=2e-3)
    assert deoxygenated[WAVELENGTH_NM == 660] > 5 * at[660]


@pytest.mark.parametrize("nm", [379.0, 781.0])
def test_wavelengths_outside_the_table_are_refused(nm):
    """No extrapolation of measured extinction."""
    with pytest.raises(ValueError, match="380 to 780"):
        blood_absorption_per_mm(np.array([nm]))


def test_physiology_moves_colour_the_right_way():
    """More melanin darkens, most in blue; more blood takes green; less oxygen takes red."""
    base = profile_of(skin(melanin=0.02)).total_reflectance
    darker = profile_of(skin(melanin=0.1)).total_reflectance
    redder = profile_of(skin(melanin=0.02, haemoglobin=0.05)).total_reflectance
    bluer = profile_of(skin(melanin=0.02, haemoglobin=0.05, oxygenation=0.2)).total_reflectance
    assert (darker < base).all()
    assert darker[2] / base[2] < darker[0] / base[0]
    assert redder[1] / base[1] < redder[0] / base[0]
    assert bluer[0] < redder[0]


@pytest.mark.parametrize(
    ("melanin", "haemoglobin", "epidermis"),
    [(0.0, 0.0, 0.25), (1e-6, 0.1, 1e-4), (0.5, 0.0, 0.25), (0.5, 0.1, 0.0), (0.5, 0.1, 1.0)],
)
def test_extremes(melanin, haemoglobin, epidermis):
    """No pigment, no blood, no epidermis: finite, energy inside [0, 1], and a fit that keeps it."""
    given = skin(melanin=melanin, haemoglobin=haemoglobin, epidermis_mm=epidermis, fit={"gaussians": 4})
    report = fit_skin(given)
    assert ((report.energy_rgb > 0) & (report.energy_rgb < 1)).all()
    np.testing.assert_allclose(report.gaussians.weight_rgb.sum(axis=0), 1, rtol=1e-9)
    assert np.isfinite(report.profile.reflectance([0.0, 1.0, 1e4])).all()


def test_red_light_travels_farthest():
    """Seen in colour, the tail of skin is red: R(r) per total falls slower in red than in blue."""
    profile = profile_of(skin(melanin=0.02))
    shape = profile.reflectance([0.1, 3.0]) / profile.total_reflectance
    fall = shape[1] / shape[0]
    assert fall[0] > fall[1] > fall[2]


def test_vector(vectors, agrees):
    """Published coefficients at three wavelengths."""
    nm = np.array(vectors["dj06"]["inputs"]["wavelengths"], float)
    brown, red = melanin_absorption_per_mm(nm)
    baseline, epidermis = baseline_absorption_per_mm(nm), epidermis_absorption_per_mm(nm, 0.02, 0.5)
    agrees("dj06", np.stack([epidermis_scattering_per_mm(nm), brown, red, baseline, epidermis], axis=1))


def test_dermis_without_blood_is_baseline():
    """No haemoglobin leaves the baseline."""
    nm = np.array([500.0, 700.0])
    np.testing.assert_array_equal(dermis_absorption_per_mm(nm, 0.0, 0.75), baseline_absorption_per_mm(nm))
