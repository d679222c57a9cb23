"""Structured inference: how a platform moves, learned from recordings, tells the biases of its IMU."""
