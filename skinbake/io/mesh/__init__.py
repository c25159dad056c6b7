"""Meshes: OBJ, glTF, PLY, STL, OFF and USD come in as a SkinMesh in millimetres with v up."""

from skinbake.io.mesh.files import mesh_files
from skinbake.io.mesh.look_mesh import read_look_mesh
from skinbake.io.mesh.orientation import guess_orientation
from skinbake.io.mesh.part_table import part_table
from skinbake.io.mesh.read_mesh import read_mesh
from skinbake.io.mesh.unwrap import unwrap_mesh
from skinbake.io.mesh.write_obj import write_obj

__all__ = ["guess_orientation", "mesh_files", "part_table", "read_look_mesh", "read_mesh", "unwrap_mesh", "write_obj"]
