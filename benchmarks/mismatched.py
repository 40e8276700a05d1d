"""Missions whose estimator assumes errors of other sizes than the drawn ones."""

from sim.config.mission import MismatchConfig, MissionConfig


def mismatched(mission: MissionConfig, seed: int) -> MissionConfig:
    """Return a mission whose estimator assumes errors that are off by factors of up to two in either direction.

    Parameters
    ----------
    mission : MissionConfig
        Mission whose sensors stay as they are, to the same drawn errors.
    seed : int
        The ratios follow from it, not from the mission's seed.

    Returns
    -------
    MissionConfig
        With other assumptions in `localization`, and landmarks that claim other errors than the drawn ones.
    """
    wide = MismatchConfig(sigma_ratio=(0.5, 2.0), landmark_ratio=(0.5, 2.0), correlation_ratio=(0.5, 2.0))
    ratio = wide.drawn_landmark_ratio(seed)
    return mission.model_copy(
        update={
            "localization": wide.assumed(mission.localization, seed),
            "mismatch": MismatchConfig(landmark_ratio=(ratio, ratio)),
        }
    )
