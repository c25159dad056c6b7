"""pyrender's renderer with our shader, our textures and a float frame buffer.

pyrender keeps what it does well: contexts, scene graph, cameras, vertex buffers, shader programs, the forward pass.
Replaced by overriding are the three places where it would lose the light: float textures (it makes 8 bit of them), the
frame buffer (8 bit), and the shader.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyrender
from numpy.typing import NDArray
from OpenGL import GL
from pyrender.constants import RenderFlags
from pyrender.renderer import Renderer
from pyrender.shader_program import ShaderProgramCache

from skinbake.errors import MachineError
from skinbake.numerics import Float
from skinbake.preview.camera import Camera
from skinbake.preview.geometry import vertex_buffers
from skinbake.preview.light_sum import SummedLobes
from skinbake.preview.mode import Mode
from skinbake.preview.picture_part import PicturePart
from skinbake.preview.scene import PreviewScene
from skinbake.preview.shader_defines import SHADERS, shader_defines
from skinbake.preview.shader_light import DIRECTIONAL, ShaderLight, shader_lights
from skinbake.preview.skin_table import table_bounds
from skinbake.preview.target import FloatTarget
from skinbake.preview.textures import TileTextures, upload, upload_oil_albedo
from skinbake.scene.lights import LightSpec

GBUFFER_ATTACHMENTS = 5


class PartCamera(pyrender.PerspectiveCamera):
    """A camera that shows `part` of its picture, all of it where that is None."""

    part: PicturePart | None = None

    def get_projection_matrix(self, width: int | None = None, height: int | None = None) -> Float:
        """Projection matrix, as pyrender asks for it.

        Parameters
        ----------
        width, height : int
            Of what is drawn into.
        """
        if self.part is None:
            whole: Float = super().get_projection_matrix(width, height)
            return whole
        return self.part.projection(super().get_projection_matrix(*self.part.whole))


class SkinRenderer(Renderer):
    """Renderer of one PreviewScene; needs a current OpenGL context for all its life.

    Attributes
    ----------
    mode : Mode
    gains_rgb : ndarray of shape (L, 3)
        Factor on each light.
    gbuffer : bool
        Write position, normal, tangent and UV beside the picture.
    target : FloatTarget
        Where frames go; set before the first frame.
    fold : bool
        Sum each lobe's lights once and not in every frame: faster from the second or third frame on.

    Raises
    ------
    MachineError
        If the lobes need more texture units than there are.
    """

    def __init__(self, scene: PreviewScene) -> None:
        super().__init__(1, 1)
        self.skin = scene
        self.mode = Mode()
        self.gains_rgb = np.ones((len(scene.lights), 3))
        self.gbuffer = False
        self.target: FloatTarget | None = None
        self.fold = False
        self._folded = SummedLobes()
        self._shader_lights = shader_lights(scene.lights)
        self._shared = {"oil_albedo": upload_oil_albedo(scene.specular)}
        if scene.open_sky:
            self._shared["sky_directions"] = upload(np.zeros((1, 1, 2, 4), np.float32))
        self._locations: dict[tuple[int, str], int] = {}
        self._textures: dict[int, TileTextures] = {}
        self._tile_of: dict[Any, int] = {}
        self._check_units()
        self.graph = self._scene_graph()
        # Ours and pyrender's own (text) programs from one cache: joining an absolute path leaves it as it is
        self._program_cache = ShaderProgramCache()

    def _check_units(self) -> None:
        """Refuse more lobes than this OpenGL has texture units for."""
        needed, units = (
            len(self.skin.lobes)
            + (9 if self.skin.open_sky else 7)
            + (4 if self.skin.table else 0)
            + bool(self.skin.maps.f0),
            int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_IMAGE_UNITS)),
        )
        if needed > units:
            raise MachineError(
                f"{len(self.skin.lobes)} lobes need {needed} texture units, this OpenGL has {units}; "
                "fit fewer Gaussians"
            )

    def _scene_graph(self) -> pyrender.Scene:
        """pyrender's scene: a mesh a tile, and one camera."""
        graph = pyrender.Scene(bg_color=np.zeros(4), ambient_light=np.zeros(3))
        for tile, buffers in vertex_buffers(self.skin.mesh, self.skin.tiles).items():
            primitive = pyrender.Primitive(
                buffers.position_mm, buffers.normal, buffers.tangent, buffers.uv, indices=buffers.faces
            )
            graph.add(pyrender.Mesh([primitive]))
            self._tile_of[primitive] = tile
            self._textures[tile] = TileTextures(self.skin, tile, self._shared)
        self._camera = PartCamera(yfov=1.0, znear=1.0, zfar=2.0)
        self._camera_node = graph.add(self._camera)
        graph.main_camera_node = self._camera_node
        low, high = self.skin.mesh.positions_mm.min(0), self.skin.mesh.positions_mm.max(0)
        self._centre, self._radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        return graph

    def draw(self, camera: Camera, part: PicturePart | None = None) -> None:
        """Draw one frame, or part of one, into `target`, unresolved.

        Parameters
        ----------
        camera : Camera
        part : PicturePart, optional
            Of the size of the target.
        """
        self._camera.part = part
        away = float((camera.position_mm - self._centre) @ camera.backward)
        far = max(away + self._radius, 1e-3) * 1.01
        # First the near one: pyrender refuses a far plane before the near one that is still there
        self._camera.znear = max((away - self._radius) * 0.99, far * 1e-3)
        self._camera.zfar = far
        self._camera.yfov = float(np.radians(camera.yfov_deg))
        self.graph.set_pose(self._camera_node, camera.pose)
        if self._uses_fold():
            basis = self.skin.basis
            grey = basis.textures - basis.in_colour if basis else 0
            self._folded.update(self._textures, self.gains_rgb, grey, self.program)
        assert self.target is not None
        self.viewport_width, self.viewport_height = self.target.width, self.target.height
        self.render(self.graph, RenderFlags.OFFSCREEN)

    def set_scene(self, scene: PreviewScene, sent: Callable[[], None] = lambda: None) -> None:
        """Draw another scene from now on, with other textures on the same mesh.

        Images that are the very same arrays as before are not sent again.

        Parameters
        ----------
        scene : PreviewScene
        sent : callable, optional
            Called after each texture that was sent: memory that it was read into may be freed.

        Raises
        ------
        ValueError
            If the mesh or the tiles differ.
        """
        if scene.mesh is not self.skin.mesh or scene.tiles != self.skin.tiles:
            raise ValueError("set_scene: expected the same mesh and tiles")
        self.skin = scene
        self.gains_rgb = np.ones((len(scene.lights), 3))
        self.set_lights(scene.lights)
        self._check_units()
        for tile, textures in self._textures.items():
            self._textures[tile] = TileTextures(scene, tile, self._shared, sent, textures)
        self._folded.delete()
        self._folded = SummedLobes()

    def set_weights(self, scene: PreviewScene) -> None:
        """Draw a scene from now on that differs from the one before in its weights alone.

        Raises
        ------
        ValueError
            If one of the two has a table and the other none.
        """
        if (scene.table is None) != (self.skin.table is None):
            raise ValueError("set_weights: expected a table where there was one")
        self.skin = scene
        for textures in self._textures.values():
            textures.set_weights(scene)

    def set_lights(self, lights: tuple[LightSpec, ...]) -> None:
        """Move the specular's lights; their baked light stays as it is."""
        self._shader_lights = shader_lights(lights)

    def show_later(self, coefficients: Float, sky: NDArray[np.float32], suns: tuple[ShaderLight, ...]) -> None:
        """Light a scene whose lights come later.

        Parameters
        ----------
        coefficients : ndarray of shape (K, 3)
            Factor on each light of the basis; may be negative.
        sky : ndarray of shape (n, 2, 4)
            Directions that the oil mirrors.
        suns : tuple of ShaderLight
            Mirrored, too.
        """
        GL.glDeleteTextures([self._shared["sky_directions"]])
        self._shared["sky_directions"] = upload(sky[None])
        # No light at all is one without colour: an array in a shader has an element
        up = np.array([0.0, 1.0, 0.0])
        nothing = ShaderLight(DIRECTIONAL, 0, up, up, (0.0, 1.0), np.zeros(3))
        self.gains_rgb, self._shader_lights = coefficients, suns or (nothing,)

    def _uses_fold(self) -> bool:
        """Whether this frame reads lobes whose lights are summed."""
        return self.fold and self.skin.separate and len(self.skin.lights) > 1 and self.mode.name != "none"

    def program(self, vertex: str, fragment: str, defines: Mapping[str, str]) -> Any:
        """Shader program from files of `shaders/`, compiled on first use.

        Parameters
        ----------
        vertex, fragment : str
            File names.
        defines : mapping of str to str
            Preprocessor symbols.
        """
        program = self._program_cache.get_program(
            vertex_shader=str(SHADERS / vertex), fragment_shader=str(SHADERS / fragment), defines=dict(defines)
        )
        if not program._in_context():
            program._add_to_context()
        return program

    # What follows overrides pyrender's own steps; the names are its names.

    def _configure_forward_pass_viewport(self, flags: int) -> None:
        if flags & RenderFlags.OFFSCREEN:
            assert self.target is not None
            self.target.bind()
            GL.glViewport(0, 0, self.target.width, self.target.height)
        else:
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, 0)
            GL.glViewport(0, 0, self.viewport_width, self.viewport_height)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthMask(GL.GL_TRUE)
        GL.glDepthFunc(GL.GL_LESS)

    def _read_main_framebuffer(self, scene: Any, flags: int) -> None:
        return None  # the target is read as floats, by whoever needs it

    def _get_primitive_program(self, primitive: Any, flags: int, program_flags: int) -> Any:
        return self.program("skin.vert", "skin.frag", self._defines(self._tile_of[primitive]))

    def _layer_gains(self) -> Float:
        """Factor on each layer that the shader reads, shape (layers, 3)."""
        if self._uses_fold() or (not self.skin.separate and self.mode.name != "none"):
            return np.ones((1, 3))
        return self.gains_rgb

    def _defines(self, tile: int) -> dict[str, str]:
        """Preprocessor symbols of a tile's shader in this mode."""
        return shader_defines(self.skin, tile, self.mode, self._shader_lights, len(self._layer_gains()), self.gbuffer)

    def _bind_lighting(self, scene: Any, program: Any, node: Any, flags: int) -> None:
        skin, mode, gains = self.skin, self.mode, self.gains_rgb
        one_lobe = mode.name == "lobe"
        weights = np.array([(1.0, 1.0, 1.0) if one_lobe else lobe.weight_rgb for lobe in skin.lobes])
        lights = np.array([light.light for light in self._shader_lights], np.int32)
        colors = np.array([light.color_rgb for light in self._shader_lights]) * (
            1.0 if skin.open_sky else gains[lights]
        )
        self._set(program, "lobe_weight", weights)
        self._set(program, "layer_gain", self._layer_gains())
        self._set(program, "total_weight", skin.total_weight_rgb[None])
        self._set(program, "light_kind", np.array([light.kind for light in self._shader_lights], np.int32))
        self._set(program, "light_layer", lights)
        self._set(program, "light_at", np.array([light.at for light in self._shader_lights]))
        self._set(program, "light_axis", np.array([light.axis for light in self._shader_lights]))
        self._set(program, "light_cosines", np.array([light.cosines for light in self._shader_lights]))
        self._set(program, "light_color", colors)
        if skin.table is not None:
            low, wide = table_bounds(skin.table)
            self._set(program, "table_low", low[None])
            self._set(program, "table_range", wide[None])
        for name, value in (
            ("albedo_exponent_after", 1 - skin.texturing.exponent_before),
            ("normal_strength", skin.maps.normal_strength),
            ("f0", skin.specular.f0),
            ("strength", skin.specular.strength),
        ):
            GL.glUniform1f(self._location(program, name), value)

    def _bind_and_draw_primitive(self, primitive: Any, pose: Float, program: Any, flags: int) -> None:
        tile = self._tile_of[primitive]
        textures = self._textures[tile]
        folded = self._folded.samplers(tile) if self._uses_fold() else {}
        for unit, name in enumerate(textures.names):
            location = self._location(program, name)
            if location >= 0:  # else this variant of the shader does not read it
                GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
                texture = folded[name] if name in folded else textures.texture(name)
                GL.glBindTexture(GL.GL_TEXTURE_2D_ARRAY, texture)
                GL.glUniform1i(location, unit)
        GL.glDisable(GL.GL_BLEND)
        GL.glEnable(GL.GL_CULL_FACE)
        GL.glCullFace(GL.GL_BACK)
        GL.glPolygonMode(GL.GL_FRONT_AND_BACK, GL.GL_FILL)
        primitive._bind()
        GL.glDrawElements(GL.GL_TRIANGLES, primitive.indices.size, GL.GL_UNSIGNED_INT, None)
        primitive._unbind()

    def _location(self, program: Any, name: str) -> int:
        """Location of a uniform, looked up once; -1 where this variant of the shader does not use it."""
        key = (program._program_id, name)
        if key not in self._locations:
            self._locations[key] = GL.glGetUniformLocation(program._program_id, name)
        return self._locations[key]

    def _set(self, program: Any, name: str, values: Any) -> None:
        """Set a whole uniform array; one that this variant of the shader does not use is ignored."""
        location = self._location(program, name)
        if location < 0:
            return
        if values.dtype == np.int32:
            GL.glUniform1iv(location, len(values), values)
        else:
            call = {2: GL.glUniform2fv, 3: GL.glUniform3fv}[values.shape[1]]
            call(location, len(values), np.ascontiguousarray(values, np.float32))

    def __del__(self) -> None:
        """Nothing: by then the context may be gone, or be another one's; `delete` frees."""

    def delete(self) -> None:
        """Free all OpenGL resources."""
        for textures in self._textures.values():
            textures.delete()
        if self._textures:
            GL.glDeleteTextures(list(self._shared.values()))
            self._folded.delete()
        self._textures = {}
        if self.target is not None:
            self.target.delete()
            self.target = None
        super().delete()
