"""Every number that the paper prints about its own method, data and results, with its section."""

from __future__ import annotations

from dataclasses import dataclass

N_VERTICES = 6890
"""Vertices of SMPL's template, N (Section 3.2)."""
N_JOINTS = 22
"""Joints of the pose vector, K: SMPL's without the hands (Section 3.2)."""
THETA_SIZE = 3 * N_JOINTS + 3
"""Width of theta: axis-angle of every joint, then the root's translation (Section 3.2)."""
N_BETAS = 10
"""Shape coefficients (Section 4.3)."""
INPUT_SIZE = N_BETAS + THETA_SIZE
"""Width of DSNet's input at each step: betas, then theta (Section 5)."""
LATENT_SIZE = 100
"""Numbers that the autoencoder keeps of a mesh (Section 4.1, Figure 3)."""
DMPL_DIRECTIONS = 8
"""Coefficients that AMASS gives of DMPL, and directions of its released model (Section 3.2)."""
DSNET_WIDTHS = {"fc_enc_1": 64, "fc_enc_2": 128, "lstm": 60, "fc_enc_3": LATENT_SIZE}
"""Outputs of DSNet's layers (Section 5)."""
CASAS_OTADUY_WIDTHS = (3 * N_VERTICES, 6000, 3000, LATENT_SIZE)
"""Inputs, then outputs of the encoder's layers of Casas and Otaduy (Section 5)."""
INFERRED_WIDTHS = (N_VERTICES, 2000, 1300, 300, 30)
"""Vertices after each convolution of the mesh autoencoder; inferred from the paper's total."""
ALTERNATIVE_WIDTHS = (N_VERTICES, 2000, 1250, 400, 20)
"""The other natural choice with exactly the paper's number of parameters."""
FEATURES = (3, 4, 9)
"""Coordinates, then the features of each vertex after the autoencoder's two linear layers."""
NEGATIVE_SLOPE = 0.1
"""Of the autoencoder's LeakyReLU, below zero; the paper does not name its nonlinearity."""
FPS = 60.0
"""Dyna's rate, to which the paper resamples all motions (Table 1)."""
CLIP_FRAMES = 300
"""Frames to which motions are padded or clipped (Section 5)."""
VALIDATION_SEQUENCE = "50004_one_leg_jump"
"""The sequence that the paper shows and never trains on (Section 6)."""
FIGURE9_MOTIONS = (
    "one_leg_jump", "jumping_jacks", "basketball_dribble_and_shoot", "side_to_side_hopping",
)  # fmt: skip
"""Observed and unobserved motions of known and unknown people (Figure 9)."""
ABSORBING_JOINT, ABSORBING_SEQUENCE = "spine2", "50025_jiggle_on_toes"
"""Whose turning took over what the flesh did, and where (Section 6, Figure 10)."""

Value = int | float | str | tuple[int | float, ...]


@dataclass(frozen=True)
class PaperNumber:
    """One number, or one silence, of the paper."""

    key: str
    """Name by which a measurement of ours is set beside it."""
    section: str
    """Where the paper prints it."""
    quantity: str
    """What it is."""
    value: Value | None
    """The number; None where the paper says nothing and a reproduction has to choose."""
    unit: str = ""
    """Its unit; `unit not stated` where the paper leaves it open."""


UNSTATED = "unit not stated"

NUMBERS: tuple[PaperNumber, ...] = (
    PaperNumber("subjects", "3.2, Table 1", "Dyna subjects of one gender", 5),
    PaperNumber("subjects_total", "1", "Dyna subjects in all", 10),
    PaperNumber("motions_per_subject", "3.2, Table 1", "motions of a subject", (10, 14)),
    PaperNumber("sequences_women", "3.3, Table 1", "Dyna sequences, women", 67),
    PaperNumber("sequences_men", "3.2, Table 1", "Dyna sequences, men", 66),
    PaperNumber("mosh_sequences_women", "3.2, Table 1", "Mosh sequences, women", 30),
    PaperNumber("mosh_sequences_men", "3.2, Table 1", "Mosh sequences, men", 24),
    PaperNumber("dyna_fps", "3.2, Table 1", "frame rate of Dyna", 60, "1/s"),
    PaperNumber("mosh_fps", "3.2, Table 1", "frame rate of Mosh before resampling", 100, "1/s"),
    PaperNumber("duration_s", "3.2", "shortest and longest motion", (2, 15), "s"),
    PaperNumber("usual_frames", "5, Figure 6", "frames of most motions", (200, 400)),
    PaperNumber("vertices", "3.2", "vertices of the template, N", N_VERTICES),
    PaperNumber("joints", "3.2", "joints without hands, K", N_JOINTS),
    PaperNumber("theta", "3.2", "pose vector theta, 22 x 3 + 3", THETA_SIZE),
    PaperNumber("betas", "4.3", "shape vector beta", N_BETAS),
    PaperNumber("amass_betas", "3.2", "shape coefficients in AMASS", 16),
    PaperNumber("amass_dmpls", "3.2", "DMPL coefficients in AMASS", DMPL_DIRECTIONS),
    PaperNumber("amass_pose", "3.2", "pose parameters in AMASS", 159),
    PaperNumber("align_lr", "3.3", "learning rate of the alignment's SGD", 0.0001),
    PaperNumber("align_momentum", "3.3", "momentum of the alignment's SGD", 0.9),
    PaperNumber("align_steps", "3.3", "SGD steps for a frame", None),
    PaperNumber("align_error_mm", "3.3", "remaining error of the alignment", None, "mm"),
    PaperNumber("mesh_size", "4.1, Figure 3", "mesh coordinates, 3N", 20_670),
    PaperNumber("latent_size", "4.1, Figure 3", "latent vector", LATENT_SIZE),
    PaperNumber("ae_layers", "Figure 3", "encoder: linear, Conv1d, linear layers", (2, 4, 1)),
    PaperNumber("ae_widths", "Figure 3", "widths of the encoder", None),
    PaperNumber("ae_activation", "4.1", "activation of the autoencoder", None),
    PaperNumber("ae_parameters", "5", "parameters of the autoencoder", 33_626_606),
    PaperNumber("casas_otaduy_parameters", "5", "parameters of Casas-Otaduy", 284_678_770),
    PaperNumber("parameter_share", "5", "autoencoder / Casas-Otaduy", 11.8, "%"),
    PaperNumber("casas_otaduy_widths", "5", "widths of Casas-Otaduy's encoder", (6000, 3000, 100)),
    PaperNumber("ae_train_frames", "5", "training meshes of the autoencoder", 15_051),
    PaperNumber("ae_validation_frames", "5", "validation meshes of the autoencoder", 6_451),
    PaperNumber("ae_train_share", "5", "training meshes of the autoencoder", 70, "%"),
    PaperNumber("ae_input_range", "5", "range of the autoencoder's input", (-1, 1)),
    PaperNumber("ae_batch", "5", "batch size of the autoencoder", 64),
    PaperNumber("ae_lr", "5", "learning rate of the autoencoder's Adam", 0.0001),
    PaperNumber("ae_epochs", "5", "epochs of the autoencoder's training", None),
    PaperNumber("ae_r2", "4.1", "R2 of the autoencoder on validation meshes", None),
    PaperNumber("clip_frames", "5, Figure 6", "frames to which motions are padded or clipped", 300),
    PaperNumber("dsnet_input", "5", "input of DSNet, 10 + 69", 79),
    PaperNumber("fc_enc_1", "5", "width of fc_enc_1 (linear)", 64),
    PaperNumber("fc_enc_2", "5", "width of fc_enc_2 (tanh)", 128),
    PaperNumber("lstm", "5", "hidden units of the LSTM, H", 60),
    PaperNumber("fc_enc_3", "5", "width of fc_enc_3", 100),
    PaperNumber("dsnet_parameters", "5", "parameters of DSNet", None),
    PaperNumber("dsnet_batch", "5", "batch size of DSNet", 16),
    PaperNumber("input_block", "5", "block of DSNet's training input", (16, 300, 69)),
    PaperNumber("output_block", "5", "block of DSNet's training output", (16, 300, 100)),
    PaperNumber("dsnet_lr", "5", "learning rate of DSNet's Adam", 0.0001),
    PaperNumber("epoch_s", "5", "training time of an epoch", 0.05, "s"),
    PaperNumber("dsnet_epochs", "5", "epochs of DSNet's training", None),
    PaperNumber("latent_scale", "5", "scale of the latents that DSNet learns", None),
    PaperNumber("validation_sequence", "6, Figure 7", "validation sequence", VALIDATION_SEQUENCE),
    PaperNumber("figure8_error", "6, Figure 8", "error over time", (0.004, 0.023), UNSTATED),
    PaperNumber("dsnet_r2", "6", "R2 of DSNet's offsets on that sequence", None),
)
"""Every number that the paper prints of its data, method and results, and those that it leaves
out; not those of its introduction and of other work (40,000 scans, 15 datasets)."""
