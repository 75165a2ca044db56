"""The paper's aligner: gradient descent with momentum on the mesh distance (Section 3.3)."""
