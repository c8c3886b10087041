"""Hands as weights of principal components, for sources that store them so."""

import numpy as np


def add_components(values: dict[str, np.ndarray], hands: dict[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """Give a model's arrays components that the first `count` of span the hands, and return the hands' weights.

    `hands` has `left_hand` and `right_hand`, (T, 45), counted from whatever the source counts them from.
    """
    weights = {}
    for side in ("left", "right"):
        pose = hands[f"{side}_hand"]
        _, _, axes = np.linalg.svd(np.linalg.qr(pose, mode="r"))  # Quick for thousands of frames, too.
        # Not in the order of the singular values: weights in another order than the model's must be seen.
        axes[:count] = axes[:count][::-1]
        values[f"hands_components{side[0]}"] = axes
        weights[f"{side}_hand"] = pose @ axes[:count].T
        assert np.allclose(weights[f"{side}_hand"] @ axes[:count], pose)
    return weights
