"""Every claim of the paper: where it stands, what was measured of it, and what follows.

A verdict is a rule on numbers, so that results made anew may turn it.
"""

from __future__ import annotations

from benchmarks.claims.of_cost import of_autoencoder, of_cost
from benchmarks.claims.of_data import of_data
from benchmarks.claims.of_network import of_network
from benchmarks.claims.of_people import of_people
from benchmarks.claims.results import Results
from benchmarks.claims.row import Claim


def claims(results: Results) -> dict[str, list[Claim]]:
    """All rows by subject."""
    return {
        "The network": list(of_network(results)),
        "Known and unknown people and motions": list(of_people(results)),
        "Cost": list(of_cost(results)),
        "The autoencoder": list(of_autoencoder(results)),
        "Data and alignment": list(of_data(results)),
    }
