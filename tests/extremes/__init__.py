"""The extremes of the design, and what must not change when nothing but the point of view does; a module a stage.

What other folders hold already is not repeated here:

* every medium, thickness and index, alone and stacked: tests/profile/test_extremes.py
* sigma from 1e-3 to 1e3 texels, one texel and 1 x N, light of 1e-8 to 1e30 and of none, NaN light refused by its
  address, faces without UV area and flipped ones: tests/diffuse/test_diffuse.py
* constant light, the same bytes for any number of threads: tests/diffuse/test_surface.py
* coverage of thin, flipped and sub-texel triangles, single-texel islands: tests/atlas/test_rasterize.py
* light exactly grazing and behind, scales of 0 to 1e30, a far mesh: tests/irradiance/test_light_texels.py
* N.H = 0 and 1, V.H over 1, L = -V, roughness 1e-4 to 1: tests/irradiance/test_oil_layer.py and
  tests/preview/test_draw.py
* NaN and Inf in maps, named by texel: tests/io/test_image.py
* a head in metres read as millimetres: tests/io/test_mesh.py
* half's 65504 and its subnormals: tests/io/test_exr.py
"""
