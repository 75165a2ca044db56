"""Paint the pictures of skin of the embedded bodies: `bridge/body/assets/embedded_skin_*.png`.

    python -m tools.paint_skin

Skin, hair, eyes, sportswear and the soft shadow of nearby skin are painted by where each texel lies
on the body at rest. The same versions on the same machine give the same bytes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bridge.body import load_body_model
from bridge.body.embedded import EMBEDDED_GENDERS, EMBEDDED_PREFIX
from tools.embedded_body.packing import write_checksums
from tools.skin.canvas import Canvas, within
from tools.skin.head import Look, eye_m, paint_head
from tools.skin.occlusion import open_share
from tools.skin.outfit import Outfit, joint, paint_outfit

ASSETS = Path(__file__).resolve().parents[1] / "bridge" / "body" / "assets"
SIZE_PX = 1536
COLOURS = 256
_FACE = (0.42, 0.62), (0.76, 0.97)
"""Rows and columns of the picture, from and to, where the face lies."""
SKINS = {"female": (0.905, 0.755, 0.665), "male": (0.86, 0.70, 0.60)}
LOOKS = {
    "female": Look((0.23, 0.15, 0.105), (0.33, 0.25, 0.16), (0.70, 0.40, 0.38), 0.0019, 0.7),
    "male": Look((0.20, 0.15, 0.12), (0.27, 0.33, 0.36), (0.66, 0.42, 0.38), 0.0029, 0.5),
}
OUTFITS = {
    "female": Outfit(
        top=(0.22, 0.33, 0.43),
        shorts=(0.18, 0.20, 0.25),
        trim=(0.80, 0.83, 0.85),
        hem_above=("spine2", -0.035),
        neck_m=(0.085, 0.125, 0.10),
        armhole_m=(0.035, 0.085, 0.0),
        waist_m=0.055,
        leg=0.40,
    ),
    "male": Outfit(
        top=(0.72, 0.74, 0.76),
        shorts=(0.18, 0.22, 0.29),
        trim=(0.80, 0.83, 0.85),
        hem_above=("pelvis", -0.01),
        neck_m=(0.085, 0.075, 0.03),
        armhole_m=(0.02, 0.10, 0.0),
        waist_m=0.05,
        leg=0.62,
    ),
}
_FLUSH = (0.80, 0.47, 0.41)
_DARKEST = 0.66
"""Of skin that sees nothing but skin."""


def paint(gender: str, size_px: int = SIZE_PX) -> NDArray[np.uint8]:
    """(size, size, 3) sRGB."""
    body = load_body_model(EMBEDDED_PREFIX + gender)
    canvas = Canvas(body, size_px)
    canvas.colours[:] = SKINS[gender]
    _flush(canvas)
    paint_head(canvas, LOOKS[gender])
    paint_outfit(canvas, OUTFITS[gender])
    canvas.darken(_DARKEST + (1 - _DARKEST) * canvas.on_texels(open_share(body)))
    return canvas.picture(SKINS[gender])


def _flush(canvas: Canvas) -> None:
    """Where blood shines through: cheeks, knees, elbows, hands and feet."""
    eye = eye_m(canvas)
    spots = (
        (eye, [0.012, -0.032, 0.0], 0.024, 0.12),
        (joint(canvas, "left_knee"), [0, 0, 0.05], 0.06, 0.14),
        (joint(canvas, "left_elbow"), [0, 0, -0.04], 0.05, 0.16),
    )
    place = np.stack([np.abs(canvas.x_m), canvas.y_m, canvas.z_m], axis=1)
    for near, apart_m, size_m, amount in spots:
        apart = np.linalg.norm(place - near - apart_m, axis=1) / size_m
        canvas.paint(_FLUSH, amount * np.exp(-(apart**2)))
    wrist, foot = joint(canvas, "left_wrist"), joint(canvas, "left_ankle")
    canvas.paint(_FLUSH, 0.10 * within(wrist[0] + 0.05 - place[:, 0], 0.05))
    canvas.paint(_FLUSH, 0.10 * within(place[:, 1] - foot[1], 0.05))


def save(picture: NDArray[np.uint8], path: Path) -> None:
    """Write a PNG of few colours, a quarter of which are the face's."""
    rows, columns = (slice(*(int(len(picture) * part) for part in ends)) for ends in _FACE)
    palette = Image.new("P", (1, 1))
    colours = [
        np.reshape(_fewer(part, count).getpalette() or [], (-1, 3))
        for part, count in ((picture, COLOURS * 3 // 4), (picture[rows, columns], COLOURS // 4))
    ]
    palette.putpalette(np.concatenate(colours).astype(np.uint8).tobytes())
    whole = Image.fromarray(picture)
    few = whole.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def _fewer(picture: NDArray[np.uint8], count: int) -> Image.Image:
    whole = Image.fromarray(np.ascontiguousarray(picture))
    return whole.quantize(count, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def main() -> None:
    """Paint both, and write the checksums of all assets."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ASSETS, help="folder to write to")
    out: Path = parser.parse_args().out
    for gender in EMBEDDED_GENDERS:
        path = out / f"embedded_skin_{gender}.png"
        save(paint(gender), path)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
    write_checksums(out)


if __name__ == "__main__":
    main()
