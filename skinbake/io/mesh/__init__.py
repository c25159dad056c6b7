"""Meshes: OBJ, glTF, PLY, STL and OFF come in as a SkinMesh in millimetres with v up."""

from skinbake.io.mesh.files import mesh_files
from skinbake.io.mesh.read_mesh import read_mesh
from skinbake.io.mesh.unwrap import unwrap_mesh
from skinbake.io.mesh.write_obj import write_obj

__all__ = ["mesh_files", "read_mesh", "unwrap_mesh", "write_obj"]
