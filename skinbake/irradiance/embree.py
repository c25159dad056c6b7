"""Embree's own functions, called on arrays of rays and from inside compiled code.

embreex brings the library. Its own class takes each corner from Python's hands, behind the interpreter's lock: .2 s for
the triangles of the sample head; here they are copied at once, and rays are asked one by one in a compiled loop.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import MachineError
from skinbake.kernels.c_call import call_with_pointers
from skinbake.kernels.compile import kernel

Vectors = NDArray[np.float32]

RAY_FLOATS = 32  # of a ray's buffer: RTCRayHit has 80 bytes, 96 where instances have two numbers
NOTHING = np.uint32(0xFFFFFFFF)
FAR = np.float32(1e37)  # no ray is longer
_TRIANGLES, _INDEX, _VERTEX, _UINT3, _FLOAT3, _ROBUST = 0, 0, 1, 0x5003, 0x9003, 4  # of rtcore's headers
_ALIGN = 16


class RayCalls(NamedTuple):
    """Addresses that kernels need to trace rays.

    Attributes
    ----------
    scene : int
    intersect, occluded : int
        Of the functions that trace one ray: to the first hit, and to any.
    """

    scene: int
    intersect: int
    occluded: int


class Hits(NamedTuple):
    """First hits of rays, each of shape (n,).

    Attributes
    ----------
    geometry : ndarray of int32
        Number of what was hit, in the order in which it was given; -1 for nothing.
    triangle : ndarray of int32
        Of that; -1 for none.
    b1, b2 : ndarrays of float32
        Barycentric weights of the triangle's corners 1 and 2.
    distance : ndarray of float32
        In lengths of the direction; `FAR` for none.
    """

    geometry: NDArray[np.int32]
    triangle: NDArray[np.int32]
    b1: NDArray[np.float32]
    b2: NDArray[np.float32]
    distance: NDArray[np.float32]


class Triangles:
    """Owner of an Embree scene; any number of threads may ask it.

    Parameters
    ----------
    parts : pairs of ndarrays of shape (V, 3), float32, and (F, 3)
        Positions, and the corners of triangles.

    Attributes
    ----------
    rays : RayCalls
        Valid as long as this object lives.
    """

    def __init__(self, *parts: tuple[Vectors, NDArray[np.integer]]) -> None:
        self._rtc = rtc = _library()
        self._device = rtc.rtcNewDevice(None)
        self._scene = rtc.rtcNewScene(self._device)
        rtc.rtcSetSceneFlags(self._scene, _ROBUST)  # no ray slips between two triangles
        for positions, faces in parts:
            geometry = rtc.rtcNewGeometry(self._device, _TRIANGLES)
            corners = np.ascontiguousarray(faces, np.uint32)
            for kind, form, values in ((_VERTEX, _FLOAT3, positions), (_INDEX, _UINT3, corners)):
                buffer = rtc.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(values))
                ctypes.memmove(buffer, values.ctypes.data, values.nbytes)
            rtc.rtcCommitGeometry(geometry)
            rtc.rtcAttachGeometry(self._scene, geometry)
            rtc.rtcReleaseGeometry(geometry)
        rtc.rtcCommitScene(self._scene)
        traces = (ctypes.cast(each, ctypes.c_void_p).value or 0 for each in (rtc.rtcIntersect1, rtc.rtcOccluded1))
        self.rays = RayCalls(self._scene, *traces)

    def __del__(self) -> None:
        if hasattr(self, "_scene"):
            self._rtc.rtcReleaseScene(self._scene)
            self._rtc.rtcReleaseDevice(self._device)

    def occluded(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Whether each ray meets anything, shape (n,).

        Parameters
        ----------
        origin : ndarray of shape (n, 3)
        direction : ndarray of shape (n, 3) or (1, 3)
            One row serves all rays.
        reach : ndarray of shape (n,)
            Distance up to which hits count, in lengths of `direction`.
        """
        answer = np.empty(len(origin), np.bool_)
        _occlude(self.rays, *_as_rays(origin, direction, reach), answer)
        return answer

    def first_hits(self, origin: Vectors, direction: Vectors) -> Hits:
        """What each ray meets first.

        Parameters
        ----------
        origin, direction : ndarrays of shape (n, 3)
        """
        count = len(origin)
        found = Hits(
            np.empty(count, np.int32), np.empty(count, np.int32),
            np.empty(count, np.float32), np.empty(count, np.float32), np.empty(count, np.float32),
        )  # fmt: skip
        _meet(self.rays, *_as_rays(origin, direction), found)
        return found


def _as_rays(*arrays: NDArray[np.floating]) -> list[NDArray[np.float32]]:
    """Arrays in the one form that the loops are compiled for."""
    return [np.ascontiguousarray(each, np.float32) for each in arrays]


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
            ("rtcOccluded1", None, [pointer, pointer, pointer]),
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


@kernel(inner=True)
def send_ray(function, scene, buffer, at, direction, reach):  # type: ignore[no-untyped-def]
    """Trace one ray; the buffer then holds its answer.

    Parameters
    ----------
    function, scene : int
        Addresses.
    buffer
        Of `ray_buffer`.
    at, direction : three floats
    reach : float
        In lengths of `direction`; may be infinite.

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
    call_with_pointers(function, scene, address)


@kernel
def _occlude(
    rays: RayCalls, origin: Vectors, direction: Vectors, reach: NDArray[np.float32], answer: NDArray[np.bool_]
) -> None:
    """Ask whether rays meet anything.

    Parameters
    ----------
    rays : RayCalls
    origin, direction, reach : ndarrays
        As of `Triangles.occluded`.
    answer : ndarray of shape (n,)
        Written.
    """
    buffer = ray_buffer()
    each = len(direction) > 1
    for i in range(len(origin)):
        send_ray(rays.occluded, rays.scene, buffer, origin[i], direction[i if each else 0], reach[i])
        answer[i] = buffer[0][8] < 0.0  # minus infinity


@kernel
def _meet(rays: RayCalls, origin: Vectors, direction: Vectors, found: Hits) -> None:
    """Find what rays meet first.

    Parameters
    ----------
    rays : RayCalls
    origin, direction : ndarrays of shape (n, 3)
    found : Hits
        Written.
    """
    buffer = ray_buffer()
    ray, bits, _ = buffer
    for i in range(len(origin)):
        send_ray(rays.intersect, rays.scene, buffer, origin[i], direction[i], FAR)
        hit = bits[18] != NOTHING
        found.geometry[i] = bits[18] if hit else -1
        found.triangle[i] = bits[17] if hit else -1
        found.b1[i], found.b2[i] = (ray[15], ray[16]) if hit else (np.float32(0.0), np.float32(0.0))
        found.distance[i] = ray[8]
