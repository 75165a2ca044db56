"""What a run will cost: the work of its stages, and how long such work took when measured."""
