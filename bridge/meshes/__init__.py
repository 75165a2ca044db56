"""Files of registered meshes."""
