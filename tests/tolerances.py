"""How far two images may lie apart, each with its reason."""

from skinbake.compare import Tolerance

# Another CPU's BLAS, exp and fused multiply-adds, then rounding to half: one step of half either way, never two
SAME_CODE = Tolerance(absolute=2e-6, relative=1e-3, allowed=0.0005, worst=3)
# Shadow rays that graze an edge may fall on its other side on another CPU: a few texels, each by much
SHADOW_EDGES = Tolerance(absolute=1e-3, relative=1e-3, allowed=0.005, worst=400)
# Software against GPU rasteriser: pixels of the silhouette cover by another rule, all others agree
PREVIEW = Tolerance(absolute=2e-3, relative=2e-3, allowed=0.01, worst=400)
