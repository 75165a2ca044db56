"""What the studies add to `dsnet`: predictors to compare with, laws and a form to test on.

    DSNET_PLUGINS=benchmarks.plugin python -m dsnet.cli train --predictors dyna_like

Frameworks are imported in each function, for no process may load both.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from bridge.plugins import VARIABLE

if TYPE_CHECKING:
    from dsnet.synthetic.tissue_laws import MakeForm, TissueLaw
    from tf_dsnet.predictors import Predictor


def use() -> None:
    """Let this process and those that it begins know them, besides the plugins of the user."""
    known = os.environ.get(VARIABLE, "").split()
    os.environ[VARIABLE] = " ".join(dict.fromkeys([*known, __name__]))


def predictors() -> Mapping[str, Predictor]:
    """Systems to compare DSNet with."""
    from benchmarks.departures.at_papers_rate import AtPapersRate
    from benchmarks.systems.casas_otaduy_like import CasasOtaduyLike
    from benchmarks.systems.dsnet_differences import DifferencesDsnet
    from benchmarks.systems.dsnet_variants import VARIANTS
    from benchmarks.systems.dyna_like import DynaLike, dyna_like_dmpl
    from benchmarks.systems.softsmpl_like import SoftSmplLike

    entries: tuple[Predictor, ...] = (
        AtPapersRate(),
        DifferencesDsnet(),
        *VARIANTS,
        DynaLike(),
        dyna_like_dmpl(),
        CasasOtaduyLike(),
        SoftSmplLike(),
    )
    return {entry.name: entry for entry in entries}


def tissues() -> Mapping[str, TissueLaw]:
    """Laws of soft tissue to test on."""
    from benchmarks.laws.second_tissue_simulation import SecondTissueSimulator
    from benchmarks.laws.third_tissue_simulation import ThirdTissueSimulator

    return {"second": SecondTissueSimulator, "third": ThirdTissueSimulator}


def mesh_forms() -> Mapping[str, MakeForm]:
    """What registrations of scans have besides soft tissue."""
    from benchmarks.laws.captured import CapturedForm

    return {"captured": CapturedForm}
