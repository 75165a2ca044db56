"""Soft tissue as a layer: `dsnet_plus` in PyTorch, with gradients, on any device."""

from torch_align_ae.tissue.soft_tissue import SoftTissue, TissueState

__all__ = ["SoftTissue", "TissueState"]
