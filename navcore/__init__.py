"""The shared language of the project: rotations, cameras, calibration, recordings, tracks, priors, estimates."""
