"""A window in fewer, longer steps: what turns within one is taken care of (Savage, "Strapdown inertial navigation
integration algorithm design", Journal of Guidance, Control, and Dynamics 1998, parts 1 and 2: coning and sculling)."""

import torch
from torch import Tensor

from ipnet.attitudes import cross
from ipnet.presets import STEP


def condensed(window: Tensor, bias: Tensor, dt: float) -> Tensor:
    """(batch, 6, n / STEP) constant rates that turn as far, and mean specific forces in B in the middles of steps.

    To second order in the angle within a step, at the biases (batch, 6), which stay in the result.

    Args:
        window: (batch, 6, n) gyro, accel.
        dt: s between samples.
    """
    free = (window - bias[..., None]).unflatten(2, (-1, STEP))
    phi, f = (part.contiguous() for part in (free[:, :3] * dt, free[:, 3:]))  # (batch, 3, n / STEP, STEP)
    before = torch.triu(torch.ones(STEP, STEP, dtype=window.dtype), diagonal=1)  # sums of all earlier samples
    eye = torch.eye(STEP, dtype=window.dtype)
    coning = cross(phi @ (before + eye.roll(1, 1).triu(1) / 6.0), phi)
    angle = phi @ (before + 0.5 * eye - 0.5)  # from the middle of the step
    turned = cross(angle, f)
    force = (f + turned + 0.5 * cross(angle, turned)).mean(3)
    rate = (phi + 0.5 * coning).sum(3) / (STEP * dt)
    return torch.cat([rate, force], dim=1) + bias[..., None]
