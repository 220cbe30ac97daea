"""Colours of curves, against a model of colour-blind eyes."""

import numpy as np
import pytest

from mjrun.palette import ON_DARK, ON_LIGHT

# G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, "A Physiologically-based Model for Simulation of Color Vision
# Deficiency", 2009, severity 1, for linear RGB.
PROTAN = [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
DEUTAN = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]
EYES = {"normal": np.eye(3), "protan": np.array(PROTAN), "deutan": np.array(DEUTAN)}
# B. Ottosson, "A perceptual color space for image processing", 2020.
CONES = np.array(
    [[0.41222, 0.5363326, 0.0514459], [0.2119035, 0.6806995, 0.1073969], [0.0883025, 0.2817188, 0.6299787]]
)
OKLAB = np.array(
    [[0.2104543, 0.7936178, -0.0040720], [1.9779985, -2.4285922, 0.4505937], [0.0259040, 0.7827718, -0.8086758]]
)


def linear(colours: np.ndarray) -> np.ndarray:
    c = colours / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def oklab(light: np.ndarray) -> np.ndarray:
    return np.cbrt(np.clip(light, 0, 1) @ CONES.T) @ OKLAB.T


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize(("palette", "ground"), [(ON_LIGHT, (255, 255, 255)), (ON_DARK, (14, 15, 18))])
def test_curves_differ_from_each_other_and_from_the_ground(
    palette: tuple[tuple[int, int, int], ...], ground: tuple[int, int, int], eye: str
) -> None:
    seen = oklab(linear(np.array([*palette, ground], float)) @ EYES[eye].T)
    distances = np.linalg.norm(seen[:, None] - seen, axis=2)[~np.eye(len(seen), dtype=bool)]
    assert distances.min() > 0.11  # 0.02 is just noticeable


@pytest.mark.parametrize(("palette", "ground"), [(ON_LIGHT, (255, 255, 255)), (ON_DARK, (14, 15, 18))])
def test_curves_contrast_with_the_ground(
    palette: tuple[tuple[int, int, int], ...], ground: tuple[int, int, int]
) -> None:
    luminance = linear(np.array([*palette, ground], float)) @ [0.2126, 0.7152, 0.0722]
    *curves, behind = luminance.tolist()
    assert all((max(c, behind) + 0.05) / (min(c, behind) + 0.05) > 2.1 for c in curves)
