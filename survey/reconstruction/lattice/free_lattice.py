"""Surface on nodes that are free in three coordinates."""
import numpy as np
def beam_covariance(xyz, origins, range_sigma_m, beam_sigma_deg):
    ray = xyz - origins
    range_m = np.linalg.norm(ray, axis=1)
    unit = ray / range_m[:, None]
    across = range_m * np.radians(beam_sigma_deg)
    along = unit[:, :, None] * unit[:, None, :]
    return range_sigma_m**2 * along + across[:, None, None] ** 2 * (np.eye(3) - along)
