"""The synthetic corpus: motions, soft tissue, and files in the formats of Dyna and AMASS."""
