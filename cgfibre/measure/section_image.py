"""Filaments in a micrograph: centres and diameters in pixels from a grey picture of a cross-section.

Pixels: x to the right along the columns, y down along the rows, (0, 0) the middle of the first pixel. The way: light
evened out, blobs of the filament's size (Laplacian of Gaussian, so touching discs stay apart), then a circle through
the edge of each, read along rays. The only module that knows scikit-image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.feature import peak_local_max
from skimage.transform import resize

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError

#: grey values, which need no double precision
Picture = npt.NDArray[np.floating[Any]]

#: rays by which the edge of a filament is read
N_RAYS = 48
#: diameter in pixels at which blobs are sought: larger pictures are reduced to it
BLOB_DIAMETER = 12.0
#: least diameter in pixels whose edge can be fitted
LEAST_DIAMETER = 6.0
#: a step at the edge counts from this part of the picture's contrast on
LEAST_STEP = 0.2
#: least share of the circumference with an edge; six touching neighbours hide about a half of it
LEAST_SUPPORT = 0.35
#: a filament is at least this bright, in parts of their median
LEAST_BRIGHTNESS = 0.4
#: two finds nearer than this part of their diameter are one
TWIN = 0.6
#: median of the magnitude of a normal variate over its s.d.
MEDIAN_OF_NORMAL = 0.6745
#: filaments fitted at a time, which bounds the memory
BATCH = 4000


@dataclass(frozen=True)
class Found:
    """Filaments found: ``centres`` (n, 2) pixels (x right, y down), ``diameter`` (n,) pixels, ``support`` (n,) share of
    the circumference (inside the picture) where an edge was seen, ``cut`` (n,) whether the picture's border cuts it.
    """

    centres: FloatArray
    diameter: FloatArray
    support: FloatArray
    cut: np.ndarray

    def __len__(self) -> int:
        return len(self.centres)

    def taken(self, keep: np.ndarray) -> Found:
        """Those of a mask or of indices."""
        return Found(self.centres[keep], self.diameter[keep], self.support[keep], self.cut[keep])


@dataclass(frozen=True)
class Detection:
    """What :func:`find_filaments` gives: the finds, their polarity, their median diameter in pixels.

    ``area_fraction`` is that of the discs (their parts inside the picture) in the whole picture, not inside an outline;
    slices of filaments whose middle is outside the picture are not counted.
    """

    filaments: Found
    polarity: Literal["bright", "dark"]
    diameter: float
    area_fraction: float


def find_filaments(
    picture: Picture, diameter: float | None = None, polarity: Literal["auto", "bright", "dark"] = "auto"
) -> Detection:
    """Filaments of a grey picture (rows, columns), of about one ``diameter`` (pixels; None: found from the picture).

    Diameters may scatter by about a quarter. ``polarity`` tells whether filaments are brighter than what is between
    them; "auto" tries both. Raises InputError for a picture that is not two-dimensional, finite and varied, for a
    diameter below :data:`LEAST_DIAMETER` pixels or beyond half of the picture, and where no filament is found.
    """
    grey = _checked(picture)
    if diameter is not None and not LEAST_DIAMETER <= diameter <= 0.5 * min(grey.shape):
        expected = f"from {LEAST_DIAMETER:g} pixels to half of the picture, {min(grey.shape) / 2:g}"
        raise InputError("diameter", f"{diameter:.4g} pixels", expected)
    signs = {"auto": (1.0, -1.0), "bright": (1.0,), "dark": (-1.0,)}
    if polarity not in signs:
        raise InputError("polarity", polarity, "'auto', 'bright' or 'dark'")
    sign, size = _size_and_sign(grey, diameter, signs[polarity])
    even = evened(sign * grey, size)
    found = _located(even, size)
    if not len(found):
        raise InputError("picture", f"{grey.shape[1]} x {grey.shape[0]} pixels", "a picture with round filaments")
    if diameter is None:
        # blobs of the size that was measured, not of the one that was guessed
        size = float(np.median(found.diameter))
        even = evened(sign * grey, size)
        found = _located(even, size)
    return Detection(
        found,
        "bright" if sign > 0 else "dark",
        float(np.median(found.diameter)),
        _covered(found, grey.shape),
    )


def _checked(picture: Picture) -> Picture:
    grey = np.asarray(picture, dtype=np.float32)
    if grey.ndim != 2 or min(grey.shape) < 2 * LEAST_DIAMETER:
        raise InputError("picture", grey.shape, f"a grey picture of {2 * LEAST_DIAMETER:g} pixels and more a side")
    if not np.all(np.isfinite(grey)):
        raise InputError("picture", "not finite", "finite grey values only")
    if float(np.ptp(grey)) == 0.0:
        raise InputError("picture", f"all {grey.flat[0]:g}", "a picture that is not of one grey")
    return grey


def evened(picture: Picture, diameter: float) -> Picture:
    """The picture with its light evened out: about 0 between the filaments and 1 on them, float32.

    In tiles of three diameters the 5th and 95th percentile stand for what is between the filaments and for them; both
    are smoothed and interpolated. Tiles that hold noise alone have no contrast of their own: contrast is taken as at
    least 0.3 of that of the other tiles, so that noise stays low. Raises InputError where every tile is noise.
    """
    tile = max(round(3.0 * diameter), 4)
    rows, columns = (max(round(n / tile), 1) for n in picture.shape)
    sigma = 0.04 * diameter
    smooth = ndimage.gaussian_filter(picture, sigma)
    # of all second differences this one sees neither slopes nor most edges (Immerkaer 1996); s.d. 6 of unit noise
    rough = np.abs(ndimage.convolve(picture, np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]))) / 6
    low, high, noise = np.empty((rows, columns)), np.empty((rows, columns)), np.empty((rows, columns))
    row_edges = np.linspace(0, picture.shape[0], rows + 1).astype(int)
    column_edges = np.linspace(0, picture.shape[1], columns + 1).astype(int)
    for i in range(rows):
        for j in range(columns):
            part = slice(row_edges[i], row_edges[i + 1]), slice(column_edges[j], column_edges[j + 1])
            low[i, j], high[i, j] = np.percentile(smooth[part], [5, 95])
            noise[i, j] = np.median(rough[part]) / MEDIAN_OF_NORMAL
    contrast = high - low
    # 5th to 95th percentile of noise after the smoothing
    shown = contrast > 1.5 * 3.29 * noise * min(1.0, 1 / (2 * np.sqrt(np.pi) * sigma))
    if not shown.any():
        raise InputError("picture", "noise alone", "filaments that stand out of the noise (of this diameter)")
    floor = 0.3 * float(np.percentile(contrast[shown], 90))
    # an empty tile tells nothing of the light between filaments but its own mean
    base = np.where(contrast < floor, 0.5 * (low + high), low)
    base, contrast = (ndimage.gaussian_filter(a, 0.7, mode="nearest") for a in (base, np.maximum(contrast, floor)))
    base, contrast = (resize(a, picture.shape, order=1, mode="edge", preserve_range=True) for a in (base, contrast))
    return ((picture - base) / np.maximum(contrast, 1e-12)).astype(np.float32)


def _blobs(even: Picture, diameter: float) -> FloatArray:
    """(n, 2) pixels: maxima of the Laplacian of Gaussian of the filament's size, sigma = r/sqrt(2) (Lindeberg 1998).

    A disc of contrast 1 has the response 2/e = 0.74 there, alone or among others of the same size.
    """
    scale = min(1.0, BLOB_DIAMETER / diameter)
    small = even
    if scale < 1.0:
        shape = tuple(max(round(n * scale), 1) for n in even.shape)
        small = resize(even, shape, order=1, anti_aliasing=True, preserve_range=True)
    factor = np.array(even.shape) / np.array(small.shape)
    sigma = 0.25 * diameter / factor.mean()
    response = -(sigma**2) * ndimage.gaussian_laplace(small, sigma, mode="nearest")
    reach = max(int(0.35 * diameter / factor.mean()), 1)
    peaks = peak_local_max(response, min_distance=reach, threshold_abs=0.05, exclude_border=False)
    return np.asarray((peaks[:, ::-1] + 0.5) * factor[::-1] - 0.5, dtype=float)


def _located(even: Picture, diameter: float) -> Found:
    """Filaments of an evened picture, without circles that are no filament and without twins.

    Those in the shade of brighter neighbours are sought once the others are wiped out.
    """
    # noise is averaged over a tenth of a diameter; wider smoothing would join the edges of neighbours
    sigma = max(0.05 * diameter, 0.6)
    smooth = ndimage.gaussian_filter(even, sigma)
    found = _refined(smooth, _blobs(even, diameter), diameter, sigma)
    rest = _refined(smooth, _blobs(_wiped(even, found), diameter), diameter, sigma)
    both = _without_twins(_joined([found, rest]))
    bright = _brightness(smooth, both.centres, both.diameter / 2)
    return both.taken(bright > LEAST_BRIGHTNESS * np.median(bright)) if len(both) else both


def _refined(smooth: Picture, candidates: FloatArray, diameter: float, sigma: float) -> Found:
    """Circles through the edges round the candidates, in batches."""
    batches = range(0, max(len(candidates), 1), BATCH)
    return _joined([_fit(smooth, candidates[k : k + BATCH], 0.5 * diameter, sigma) for k in batches])


def _joined(parts: list[Found]) -> Found:
    return Found(*(np.concatenate([getattr(p, name) for p in parts]) for name in Found.__dataclass_fields__))


def _wiped(even: Picture, found: Found) -> Picture:
    """The picture with the filaments found, and a tenth of a radius round them, as dark as what is between them."""
    rest = np.minimum(even, 1.0)
    for (x, y), d in zip(found.centres, found.diameter, strict=True):
        r = 0.55 * d
        rows = slice(max(int(y - r), 0), int(y + r) + 2)
        columns = slice(max(int(x - r), 0), int(x + r) + 2)
        part = rest[rows, columns]
        v, u = np.ogrid[rows.start : rows.start + part.shape[0], columns.start : columns.start + part.shape[1]]
        part[(u - x) ** 2 + (v - y) ** 2 <= r**2] = 0.0
    return rest


@dataclass(frozen=True)
class _Window:
    """Along which radii an edge is sought, in parts of the present radius, and how strongly outliers are put aside."""

    reach: float
    tolerance: float


#: coarse to fine
_WINDOWS = (_Window(0.45, 0.25), _Window(0.3, 0.12), _Window(0.22, 0.08), _Window(0.22, 0.08))


def _fit(smooth: Picture, centres: FloatArray, radius: float, sigma: float) -> Found:
    """Fit a circle to the steepest fall of brightness along rays, four times with narrowing windows.

    Linearised about the present circle, the edge at angle t stands off by dr + dx cos t + dy sin t; least squares
    weighted by the fall and by Tukey's biweight of the last residual, so that rays into a touching neighbour drop out.
    Smoothing by ``sigma`` draws the steepest place of a disc's edge inwards by sigma^2/(2 r), which is put back.
    """
    if not len(centres):
        return Found(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0, dtype=bool))
    height, width = smooth.shape
    n = len(centres)
    t = 2 * np.pi * np.arange(N_RAYS) / N_RAYS
    basis = np.stack([np.ones(N_RAYS), np.cos(t), np.sin(t)], axis=1)
    c, r = centres.astype(float).copy(), np.full(n, float(radius))
    for window in _WINDOWS:
        edge, fall, inside = _edges(smooth, c, r, basis, window.reach)
        off = edge - r[:, None]
        # squared: where a neighbour touches, the fall is small and its place is drawn inwards
        trust = np.where(inside, np.clip(fall, 0.0, 1.0), 0.0) ** 2
        weight = trust
        for _ in range(4):
            shift = _solve(basis, weight, off)
            left = np.abs(off - shift @ basis.T) / (window.tolerance * r[:, None])
            weight = trust * np.maximum(1 - left**2, 0.0) ** 2
        limit = 0.3 * radius
        r = np.clip(r + np.clip(shift[:, 0], -limit, limit), 0.6 * radius, 1.45 * radius)
        c = c + np.clip(shift[:, 1:], -limit, limit)
    bounded = (r > 0.61 * radius) & (r < 1.44 * radius)  # at its bound a circle found an edge of something else
    seen = inside & (fall > LEAST_STEP) & (np.abs(edge - r[:, None]) < 0.15 * r[:, None])
    r = r + sigma**2 / (2 * r)
    support = seen.sum(axis=1) / np.maximum(inside.sum(axis=1), 1)
    cut = ((c - r[:, None] < -0.5) | (c + r[:, None] > np.array([width, height]) - 0.5)).any(axis=1)
    within = ((c >= -0.5) & (c <= np.array([width, height]) - 0.5)).all(axis=1)
    strayed = np.hypot(*(c - centres).T) > 0.6 * radius
    enough = (support >= LEAST_SUPPORT) & (inside.sum(axis=1) >= N_RAYS // 3)
    good = within & ~strayed & bounded & enough
    return Found(c, 2 * r, support, cut).taken(good)


def _edges(
    smooth: Picture, c: FloatArray, r: FloatArray, basis: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """(edge, fall, inside), each (n, rays): radius of the steepest fall, the fall across it, ray within the picture."""
    typical = float(np.median(r))
    half = max(int(np.ceil(reach * typical / max(0.04 * typical, 0.35))), 3)
    offsets = np.arange(-half - 1, half + 2) / (half + 1) * reach
    radii = r[:, None, None] * (1 + offsets)
    x = c[:, 0, None, None] + radii * basis[None, :, 1, None]
    y = c[:, 1, None, None] + radii * basis[None, :, 2, None]
    profile = ndimage.map_coordinates(smooth, [y, x], order=1, mode="nearest")
    slope = profile[:, :, :-2] - profile[:, :, 2:]  # over two steps, at radii[1:-1]
    # a mild preference for the present circle, so that a neighbour's far edge does not win by noise
    prior = 1 - 0.3 * (offsets[1:-1] / reach) ** 2
    k = np.argmax(slope * prior, axis=2)
    kk = np.clip(k, 1, slope.shape[2] - 2)
    before, at, after = (np.take_along_axis(slope, kk[:, :, None] + d, axis=2)[:, :, 0] for d in (-1, 0, 1))
    bend = before - 2 * at + after
    part = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    place = offsets[1 + kk] + np.clip(part, -1, 1) * (offsets[1] - offsets[0])
    edge = r[:, None] * (1 + place)
    # the fall from 0.12 r inside the edge to 0.12 r outside
    spread = max(round(0.12 / (offsets[1] - offsets[0])), 1)
    inner = np.take_along_axis(profile, np.maximum(kk + 1 - spread, 0)[:, :, None], axis=2)[:, :, 0]
    outer = np.take_along_axis(profile, np.minimum(kk + 1 + spread, profile.shape[2] - 1)[:, :, None], axis=2)[:, :, 0]
    height, width = smooth.shape
    ex = c[:, 0, None] + edge * basis[None, :, 1]
    ey = c[:, 1, None] + edge * basis[None, :, 2]
    inside = (ex >= 0) & (ex <= width - 1) & (ey >= 0) & (ey <= height - 1)
    return edge, inner - outer, inside


def _solve(basis: FloatArray, weight: FloatArray, off: FloatArray) -> FloatArray:
    """(n, 3) weighted least squares of ``off`` (n, rays) on ``basis`` (rays, 3), one system a filament."""
    normal = np.einsum("nk,ki,kj->nij", weight, basis, basis) + 1e-3 * np.eye(3)
    return np.linalg.solve(normal, np.einsum("nk,ki,nk->ni", weight, basis, off)[:, :, None])[:, :, 0]


def _brightness(smooth: Picture, c: FloatArray, r: FloatArray) -> FloatArray:
    """(n,) median of the inside of each circle, at its middle and on two rings."""
    t = 2 * np.pi * np.arange(12) / 12
    at = np.concatenate([np.zeros((1, 2)), *(q * np.stack([np.cos(t), np.sin(t)], axis=1) for q in (0.35, 0.65))])
    x = c[:, 0, None] + r[:, None] * at[:, 0]
    y = c[:, 1, None] + r[:, None] * at[:, 1]
    return np.asarray(np.median(ndimage.map_coordinates(smooth, [y, x], order=1, mode="nearest"), axis=1))


def _without_twins(found: Found) -> Found:
    """Of finds nearer than :data:`TWIN` diameters the one with the better edge."""
    if len(found) < 2:
        return found
    pairs = cKDTree(found.centres).query_pairs(TWIN * float(found.diameter.max()), output_type="ndarray")
    gap = np.hypot(*(found.centres[pairs[:, 0]] - found.centres[pairs[:, 1]]).T)
    pairs = pairs[gap < TWIN * found.diameter[pairs].mean(axis=1)]
    keep = np.ones(len(found), dtype=bool)
    order = np.argsort(-found.support[pairs].max(axis=1), kind="stable")
    for i, j in pairs[order]:
        if keep[i] and keep[j]:
            keep[j if found.support[i] >= found.support[j] else i] = False
    return found.taken(keep)


def _size_and_sign(grey: Picture, diameter: float | None, signs: tuple[float, ...]) -> tuple[float, float]:
    """(sign, diameter): the polarity and the size whose circles have the most edge, from the middle of the picture.

    Sizes are tried from :data:`LEAST_DIAMETER` pixels in steps of a fifth; each is judged by the summed area of what is
    found, weighted by its support squared, over the area that is bright.
    """
    if diameter is not None and len(signs) == 1:
        return signs[0], diameter
    sizes = [diameter] if diameter is not None else list(_sizes(min(grey.shape)))
    best, answer = 0.0, (signs[0], sizes[0])
    for size in sizes:
        side = int(24 * size)
        y0, x0 = (max((n - side) // 2, 0) for n in grey.shape)
        part = grey[y0 : y0 + side, x0 : x0 + side]
        scale = min(1.0, 1.5 * BLOB_DIAMETER / size)
        if scale < 1.0:
            part = resize(part, tuple(round(n * scale) for n in part.shape), anti_aliasing=True, preserve_range=True)
        if float(np.ptp(part)) == 0.0:
            continue
        for sign in signs:
            try:
                even = evened(sign * part, size * scale)
            except InputError:
                continue
            found = _located(even, size * scale)
            # a fit that ran to its bound found an edge of something else
            found = found.taken(np.abs(found.diameter / (size * scale) - 1) < 0.3)
            bright = int(np.sum(ndimage.gaussian_filter(even, 1.0) > 0.5))
            value = float(np.sum(found.diameter**2 * found.support**2)) / max(bright, 1)
            if value > best:
                best, answer = value, (sign, float(np.median(found.diameter)) / scale)
    return answer[0], answer[1] if diameter is None else diameter


def _sizes(side: int) -> FloatArray:
    most = min(0.25 * side, 400.0)
    steps = max(int(np.log(most / LEAST_DIAMETER) / np.log(1.2)) + 1, 1)
    return np.asarray(LEAST_DIAMETER * 1.2 ** np.arange(steps, dtype=float))


def _covered(found: Found, shape: tuple[int, int]) -> float:
    """Area of the discs inside the picture over the picture's; that of cut ones is counted on a grid of points."""
    area = float(np.sum(np.pi * found.diameter[~found.cut] ** 2 / 4))
    u = np.linspace(-1, 1, 41)
    disc = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= 1]
    for c, d in zip(found.centres[found.cut], found.diameter[found.cut], strict=True):
        at = c + 0.5 * d * disc
        area += np.pi * d**2 / 4 * np.mean(((at >= -0.5) & (at <= np.array(shape[::-1]) - 0.5)).all(axis=1))
    return area / (shape[0] * shape[1])


# --- scale -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ScaleBar:
    """A scale bar: ``length`` pixels, and the picture ``without`` it (its pixels, and two round them, as their mean
    surroundings)."""

    length: float
    without: Picture


def find_scale_bar(picture: Picture) -> ScaleBar:
    """The longest horizontal bar of the picture's extreme grey.

    A bar is a patch of the brightest (or darkest) grey at least five times as wide as high whose fullest row fills at
    least 0.9 of its width; ends may carry ticks. Raises InputError where there is none or where two could be it.
    """
    grey = _checked(picture)
    low, high = float(grey.min()), float(grey.max())
    bars: list[tuple[int, int, tuple[slice, ...]]] = []
    for extreme in (grey >= high - 0.02 * (high - low), grey <= low + 0.02 * (high - low)):
        labels, _ = ndimage.label(extreme)
        for k, patch in enumerate(ndimage.find_objects(labels), start=1):
            wide, tall = (patch[i].stop - patch[i].start for i in (1, 0))
            if wide < 20 or wide < 5 * tall or wide > 0.95 * grey.shape[1]:
                continue
            if int((labels[patch] == k).sum(axis=1).max()) >= 0.9 * wide:
                bars.append((wide, len(bars), patch))
    bars.sort(reverse=True)
    if not bars:
        raise InputError("--scale-bar", "not found", "a bar of the extreme grey; give its pixels: '50 um:293'")
    if len(bars) > 1 and bars[1][0] > 0.8 * bars[0][0]:
        shown = " and ".join(f"{wide} pixels" for wide, _, _ in bars[:2])
        raise InputError("--scale-bar", f"bars of {shown}", "one bar; give its pixels: '50 um:293'")
    wide, _, (rows, columns) = bars[0]
    rim, inner = (tuple(slice(max(part.start - pad, 0), part.stop + pad) for part in (rows, columns)) for pad in (6, 2))
    around = np.ones(grey.shape, dtype=bool)
    around[inner] = False
    without = grey.copy()
    without[inner] = float(np.median(grey[rim][around[rim]]))
    return ScaleBar(float(wide), without)


# --- to micrometres --------------------------------------------------------------------------------------------------


def to_micrometres(found: Found, shape: tuple[int, int], pixels_per_um: float) -> tuple[FloatArray, FloatArray]:
    """(centres (n, 2) um of y right and z up from the picture's lower left corner, diameters (n,) um).

    Raises InputError unless ``pixels_per_um`` is above 0.
    """
    if not (np.isfinite(pixels_per_um) and pixels_per_um > 0):
        raise InputError("--pixels-per-um", pixels_per_um, "a number above 0")
    y = (found.centres[:, 0] + 0.5) / pixels_per_um
    z = (shape[0] - 0.5 - found.centres[:, 1]) / pixels_per_um
    return np.stack([y, z], axis=1), found.diameter / pixels_per_um
