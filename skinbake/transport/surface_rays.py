"""Embree called from inside compiled code: a random walk asks for one short ray after another, none of them in a batch.

embreex hands arrays of rays to Embree. Here its library's own C functions are called, on a scene made the same way, so
that a whole walk is one compiled loop: nothing is copied between its rays, and threads need not wait for each other.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import MachineError
from skinbake.irradiance.smooth_surface import SmoothSurface
from skinbake.kernels.c_call import call_with_pointers
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float, normalized

RAY_FLOATS = 32  # of a ray's buffer: RTCRayHit has 80 bytes, 96 where instances have two numbers
NOTHING = np.uint32(0xFFFFFFFF)
_TRIANGLES, _INDEX, _VERTEX, _UINT3, _FLOAT3, _ROBUST = 0, 0, 1, 0x5003, 0x9003, 4  # of rtcore's headers
_ALIGN = 16


class RayScene(NamedTuple):
    """What kernels need to trace rays; positions are relative to `centre_mm`.

    Attributes
    ----------
    scene, intersect : int
        Addresses of the scene and of the function that traces one ray.
    centre_mm : ndarray of shape (3,)
    corner_mm, corner_normal : ndarrays of shape (F, 3, 3), float32
        Triangles as rays meet them, and the unit normals of the smooth surface at their corners.
    normal : ndarray of shape (F, 3)
        Unit, of the flat triangles, outwards.
    step_mm : float
        Distance from a triangle at which rays begin, beyond the round-off of its coordinates.
    """

    scene: int
    intersect: int
    centre_mm: Float
    corner_mm: NDArray[np.float32]
    corner_normal: NDArray[np.float32]
    normal: Float
    step_mm: float


class SurfaceRays:
    """Owner of an Embree scene of one surface, counter-clockwise from outside.

    Attributes
    ----------
    rays : RayScene
        Valid as long as this object lives.
    levels : int
        Of the surface: its triangles lie in the faces of a mesh as `SmoothSurface` says.
    """

    def __init__(self, surface: SmoothSurface) -> None:
        self.levels = surface.levels
        rtc = _library()
        low, high = surface.positions_mm.min(axis=0), surface.positions_mm.max(axis=0)
        centre = (low + high) / 2
        positions = np.ascontiguousarray(surface.positions_mm - centre, dtype=np.float32)
        faces = np.ascontiguousarray(surface.faces, dtype=np.uint32)
        self._rtc, self._device = rtc, rtc.rtcNewDevice(None)
        self._scene = rtc.rtcNewScene(self._device)
        rtc.rtcSetSceneFlags(self._scene, _ROBUST)  # no ray slips between two triangles
        geometry = rtc.rtcNewGeometry(self._device, _TRIANGLES)
        for kind, form, values in ((_VERTEX, _FLOAT3, positions), (_INDEX, _UINT3, faces)):
            buffer = rtc.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(values))
            ctypes.memmove(buffer, values.ctypes.data, values.nbytes)
        rtc.rtcCommitGeometry(geometry)
        rtc.rtcAttachGeometry(self._scene, geometry)
        rtc.rtcReleaseGeometry(geometry)
        rtc.rtcCommitScene(self._scene)
        corner = positions[surface.faces]
        wide = corner.astype(np.float64)
        normal = normalized(np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0]))
        intersect = ctypes.cast(rtc.rtcIntersect1, ctypes.c_void_p).value
        spacing = float(np.spacing(np.abs(positions).max()))
        self.rays = RayScene(
            self._scene, int(intersect or 0), centre, corner, surface.corner_normal.astype(np.float32), normal,
            16 * spacing,
        )  # fmt: skip

    def __del__(self) -> None:
        if hasattr(self, "_scene"):
            self._rtc.rtcReleaseScene(self._scene)
            self._rtc.rtcReleaseDevice(self._device)


@functools.cache
def _library() -> Any:
    """Embree's functions, as the library that embreex was linked to has them.

    Raises
    ------
    MachineError
        If that library cannot be reached from here.
    """
    from embreex import rtcore_scene

    try:
        rtc = ctypes.CDLL(rtcore_scene.__file__)
        pointer, number = ctypes.c_void_p, ctypes.c_uint
        for name, returns, arguments in (
            ("rtcNewDevice", pointer, [ctypes.c_char_p]),
            ("rtcNewScene", pointer, [pointer]),
            ("rtcNewGeometry", pointer, [pointer, number]),
            ("rtcSetSceneFlags", None, [pointer, number]),
            ("rtcSetNewGeometryBuffer", pointer, [pointer, number, number, number, ctypes.c_size_t, ctypes.c_size_t]),
            ("rtcCommitGeometry", None, [pointer]),
            ("rtcAttachGeometry", number, [pointer, pointer]),
            ("rtcReleaseGeometry", None, [pointer]),
            ("rtcCommitScene", None, [pointer]),
            ("rtcReleaseScene", None, [pointer]),
            ("rtcReleaseDevice", None, [pointer]),
            ("rtcIntersect1", None, [pointer, pointer, pointer]),
        ):
            function = getattr(rtc, name)
            function.restype, function.argtypes = returns, arguments
    except (OSError, AttributeError) as error:
        raise MachineError(f"embreex: expected Embree 4 beside it, could not call it: {error}") from error
    return rtc


@kernel(inner=True)
def ray_buffer():  # type: ignore[no-untyped-def]
    """Room for a ray on a boundary that Embree wants, as float32, as uint32, and its address; one for each thread."""
    room = np.empty(RAY_FLOATS + _ALIGN, np.float32)
    skip = (-room.ctypes.data // 4) % (_ALIGN // 4)
    ray = room[skip : skip + RAY_FLOATS]
    return ray, ray.view(np.uint32), ray.ctypes.data


@kernel
def first_hit(rays, buffer, at, direction, reach):  # type: ignore[no-untyped-def]
    """Distance (`reach` where nothing is hit), triangle (-1: none) and barycentrics 1 and 2 of a ray's first hit.

    Parameters
    ----------
    rays : RayScene
    buffer
        Of `ray_buffer`.
    at, direction : tuples of three floats
        Origin, mm about the scene's centre, and unit direction.
    reach : float
        mm; may be infinite.

    References
    ----------
    [Wald2014]
    """
    ray, bits, address = buffer
    ray[0], ray[1], ray[2], ray[3] = at[0], at[1], at[2], 0.0
    ray[4], ray[5], ray[6], ray[7] = direction[0], direction[1], direction[2], 0.0
    ray[8] = reach
    bits[9], bits[10], bits[11] = NOTHING, np.uint32(0), np.uint32(0)
    bits[18] = NOTHING  # geomID
    bits[19], bits[20] = NOTHING, NOTHING
    call_with_pointers(rays.intersect, rays.scene, address)
    if bits[18] == NOTHING:
        return reach, -1, 0.0, 0.0
    return np.float64(ray[8]), np.int64(bits[17]), np.float64(ray[15]), np.float64(ray[16])
