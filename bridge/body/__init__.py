"""Body models: the embedded CC0 bodies, SMPL's files, and a float64 reference of posing."""

from bridge.body.embedded import load_body_model, load_paper_body
from bridge.body.model_data import BodyModelData
from bridge.body.posing import pose_vertices

__all__ = ["BodyModelData", "load_body_model", "load_paper_body", "pose_vertices"]
