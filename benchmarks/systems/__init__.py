"""Predictors that are there to be compared with DSNet; `benchmarks.plugin` registers them.

DSNet changed one way at a time, and systems after what was published of Dyna, Casas and Otaduy and
SoftSMPL. None of these published training code: `departures` of each says what is ours.
"""
