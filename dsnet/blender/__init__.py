"""A Blender extension: soft tissue on a mesh of SMPL's family, or on a body beside an armature."""
