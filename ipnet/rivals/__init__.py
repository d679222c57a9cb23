"""What inference is held against: sources of bias priors that are simpler, or that others have published."""
