"""Evaluation: how far from the truth, how honest about it, and which of two ways is better."""
