"""What moving bodies take on disk: how small, how exact and how fast each way to store them is."""
