"""Micrographs rendered from known filaments: discs with blur, noise, uneven light and scatter."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from cgfibre.build.packing import random_packing

UM = 7.0  # diameter


@dataclass(frozen=True)
class Microscope:
    """How the picture is taken: ``pixels_per_um``, ``blur`` and ``noise`` (s.d., pixels and parts of the contrast),
    ``shade`` (the darkest corner over the brightest), ``scatter`` of the filaments' brightness, ``dark`` filaments."""

    pixels_per_um: float = 4.0
    blur: float = 1.2
    noise: float = 0.08
    shade: float = 0.5
    scatter: float = 0.06
    dark: bool = False


PLAIN = Microscope(pixels_per_um=2.5, blur=0.8, noise=0.08)
#: volume fraction, what differs from PLAIN, what differs in the bundle
CASES = {
    "loose": (0.55, {}, {}),
    "dense": (0.75, {}, {}),  # almost as dense as discs at random get
    "all touch": (0.60, {}, {"touch": 1.0}),
    "uneven light": (0.65, {"shade": 0.25}, {}),
    "noise": (0.65, {"noise": 0.2}, {}),
    "small": (0.65, {"pixels_per_um": 1.5, "blur": 0.6}, {}),
    "large": (0.65, {"pixels_per_um": 5.86, "blur": 1.8}, {}),
    "unequal": (0.55, {}, {"spread": 0.06}),
    "dark": (0.65, {"dark": True}, {}),
}


def draw(centres, diameters, shape, microscope, rng):
    """8-bit picture of discs at pixel centres (n, 2) (x right, y down), diameters (n,) in pixels."""
    height, width = shape
    picture = np.zeros(shape, dtype=np.float32)
    brightness = 1 + microscope.scatter * rng.standard_normal(len(centres))
    for (x, y), d, b in zip(centres, diameters, brightness, strict=True):
        r = d / 2
        x0, x1 = max(int(x - r - 2), 0), min(int(x + r + 3), width)
        y0, y1 = max(int(y - r - 2), 0), min(int(y + r + 3), height)
        if x0 >= x1 or y0 >= y1:
            continue
        far = np.hypot(np.arange(x0, x1)[None, :] - x, np.arange(y0, y1)[:, None] - y)
        picture[y0:y1, x0:x1] = np.maximum(picture[y0:y1, x0:x1], b * np.clip(r - far + 0.5, 0, 1))
    if microscope.dark:
        picture = 1 - picture
    picture = gaussian_filter(picture, microscope.blur)
    u, v = np.linspace(-1, 1, width)[None, :], np.linspace(-1, 1, height)[:, None]
    light = 1 - (1 - microscope.shade) * np.clip(0.5 + 0.35 * u + 0.15 * v + 0.2 * (u**2 + v**2 - 0.5), 0, 1)
    picture = (0.2 + picture) * light
    picture += microscope.noise * light.mean() * rng.standard_normal(shape)
    return np.clip(40 + 150 * picture, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Specimen:
    """A picture with what is in it: ``centres`` (n, 2) px (x right, y down) and ``diameters`` (n,) px."""

    picture: np.ndarray
    centres: np.ndarray
    diameters: np.ndarray


def bundle(count, volume_fraction, microscope, rng, spread=0.03, touch=0.25, margin=3.0):
    """A round random bundle; ``spread`` is the s.d. of diameters (their mean below 7 um so that none overlap deeply),
    ``touch`` the share of filaments that are pushed against their nearest neighbour."""
    centres = random_packing(count, UM, volume_fraction, rng)
    centres = _touching(centres, touch, rng)
    diameters = UM * np.clip(1 + spread * rng.standard_normal(count), 1 - 2.5 * spread, 1 + 2.5 * spread)
    scale = microscope.pixels_per_um
    low = centres.min(axis=0) - UM * margin
    size = np.ptp(centres, axis=0) + 2 * UM * margin
    pixels = (centres - low) * scale
    shape = int(size[1] * scale), int(size[0] * scale)
    return Specimen(draw(pixels, diameters * scale, shape, microscope, rng), pixels, diameters * scale)


def _touching(centres, share, rng):
    """Some filaments moved until they touch their nearest neighbour, where that makes no overlap."""
    moved = centres.copy()
    for i in rng.permutation(len(moved))[: int(share * len(moved))]:
        far = np.linalg.norm(moved - moved[i], axis=1)
        far[i] = np.inf
        j = int(np.argmin(far))
        trial = moved[j] + (moved[i] - moved[j]) * UM / far[j]
        others = np.linalg.norm(moved - trial, axis=1)
        others[i] = np.inf
        if others.min() >= UM * (1 - 1e-9):
            moved[i] = trial
    return moved


@dataclass(frozen=True)
class Score:
    """How well finds match: ``found`` and ``false`` shares, errors (n_matched,) of centre and diameter in diameters."""

    found: float
    false: float
    centre_error: np.ndarray
    diameter_error: np.ndarray


def score(specimen, centres, diameters):
    """Match finds with what is there: nearest pairs within half a diameter, each used once."""
    from scipy.spatial import cKDTree

    near, i = cKDTree(specimen.centres).query(centres)
    used, pairs = set(), []
    for k in np.argsort(near):
        if near[k] < 0.5 * specimen.diameters[i[k]] and i[k] not in used:
            used.add(i[k])
            pairs.append((k, i[k]))
    k, i = np.array(pairs).T
    d = specimen.diameters[i]
    return Score(
        len(pairs) / len(specimen.centres),
        (len(centres) - len(pairs)) / max(len(centres), 1),
        np.linalg.norm(centres[k] - specimen.centres[i], axis=1) / d,
        (diameters[k] - d) / d,
    )
