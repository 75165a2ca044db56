"""Which run is planned, and the settings that its stages would be given."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from bridge.options import PositiveFloat, Seed

Config = TypeVar("Config")


@dataclass(frozen=True)
class PlanConfig:
    """Say what a run would cost, stage by stage: work, time, memory and disk; make nothing.

    Takes what `./reproduce.sh` takes. Times are those of a measured run in proportion to the work.
    Costs some seconds.
    """

    run: str = "demo"
    """Run that is planned; what it has finished costs nothing more."""
    profile: Literal["smoke", "demo", "paper"] = "demo"
    """Settings of all stages."""
    seed: Seed = 0
    """Seed of the corpus and of every training."""
    gender: Literal["female", "male"] = "female"
    """Of the synthetic people."""
    aligner: Literal["sgd", "robust", "both"] | None = None
    """Aligner; the profile's when left out."""
    smpl: Path | None = None
    """SMPL model file, given together with `dyna`."""
    dyna: tuple[Path, ...] = ()
    """Dyna or D-FAUST HDF5 files in place of a synthetic corpus."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs to predict in place of the corpus's."""
    amass_fps: PositiveFloat | None = None
    """Frames per second of these files, where what they say of themselves is wrong."""

    def arguments(self) -> Iterator[str]:
        """The command line that says the same."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and value != ():
                yield f"--{field.name.replace('_', '-')}"
                yield from map(str, value if isinstance(value, tuple) else (value,))


def seeded(config: Config, seed: int) -> Config:
    """A stage's configuration with this seed, if it has one."""
    has_seed = any(field.name == "seed" for field in fields(config))  # type: ignore[arg-type]
    return replace(config, seed=seed) if has_seed else config  # type: ignore[type-var]


def settings_of(config: Any) -> dict[str, Any]:
    """A stage's settings as its manifest will hold them."""
    plain = json.loads(json.dumps(asdict(config), default=str))
    return {name: value for name, value in plain.items() if name != "run"}
