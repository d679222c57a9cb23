"""Sources of bias priors that need no network; each module's `make` is an entry point."""
