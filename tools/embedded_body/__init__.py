"""Steps of `tools/build_embedded_body.py`, in the order in which it runs them.

`makehuman` samples body shapes, `weights` smooths the rig's, `tpose` straightens the arms,
`decimate` reduces the mesh to 6890 vertices, `shape_space` finds betas and the joint regressor,
`correctives` fits the pose blend shapes, `packing` writes the asset. `symmetry` keeps halves equal.
"""
