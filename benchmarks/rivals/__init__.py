"""Systems of others that run as they are, on the clips and with the scores of the comparison.

Their code is never part of this project: each is given the folder in which it lies.
"""
