"""The shared language of the project: rotations, cameras, calibration, recordings, priors, estimates."""
