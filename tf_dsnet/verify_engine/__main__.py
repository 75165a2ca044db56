"""Serve the operations."""

from __future__ import annotations

from bridge.verify.protocol import serve
from tf_dsnet.verify_engine import body, dsnet, files, mesh_autoencoder, oscillators

if __name__ == "__main__":
    serve(
        {
            "dsnet_forward": dsnet.forward,
            "dsnet_train": dsnet.train,
            "ae_forward": mesh_autoencoder.forward,
            "ae_train": mesh_autoencoder.train,
            "smpl": body.smpl,
            "oscillators_train": oscillators.train,
            "formats": files.formats,
        },
        packages=("tensorflow", "keras"),
    )
