"""Independent random streams of one recording, so that one can change and the others stay."""

from dataclasses import dataclass

import numpy as np

from sim.errors import ConfigError

_STREAMS = 4


@dataclass(frozen=True)
class Streams:
    """One generator for each thing that is drawn."""

    motion: np.random.Generator
    world: np.random.Generator  # layout, textures, landmarks
    imu: np.random.Generator  # biases and noise
    vision: np.random.Generator  # pixel noise, lost tracks, image noise

    @staticmethod
    def of(seed: int, noise_seed: int | None = None) -> "Streams":
        """Streams of a seed; with `noise_seed` another draw of IMU and vision over the same motion and world.

        Raises:
            ConfigError: a negative seed.
        """
        if seed < 0 or (noise_seed is not None and noise_seed < 0):
            raise ConfigError(f"seeds are {seed} and {noise_seed}; expected 0 or more")
        motion, world, imu, vision = np.random.SeedSequence(seed).spawn(_STREAMS)
        if noise_seed is not None:
            imu, vision = np.random.SeedSequence(seed, spawn_key=(_STREAMS + noise_seed,)).spawn(2)
        return Streams(*(np.random.default_rng(s) for s in (motion, world, imu, vision)))
