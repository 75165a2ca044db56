"""How good results are: errors on posed meshes, absorption, and the stage `evaluate`."""
