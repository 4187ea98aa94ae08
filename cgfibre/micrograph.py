"""Verb ``section``: from the picture of a cross-section to filament centres in um, statistics, and a scene to run."""

from __future__ import annotations

import re
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cgfibre import plot, store, units
from cgfibre.build.packing import min_distance, separated
from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.measure import distribution
from cgfibre.measure.section_image import Detection, Picture, find_filaments, find_scale_bar, to_micrometres

#: what the verb leaves in its folder
FILES = ("centres.csv", "summary.json", "overlay.png", "statistics.png", "scene.toml")
#: most pixels of a picture: 400 million, about 2 GB while it is worked on
MOST_PIXELS = 400_000_000


@dataclass(frozen=True)
class MicrographOptions:
    """How to read a picture.

    Attributes: ``out`` folder; exactly one of ``pixels_per_um`` and ``scale_bar`` ("50 um": a bar in the picture of
    that length, found; "50 um:293": of so many pixels); ``diameter`` um about, None: from the picture; ``filaments``
    brighter or darker than what is between them; ``crop`` (left, top, right, bottom) pixels to look at; ``force``
    overwrites earlier results.
    """

    out: Path
    pixels_per_um: float | None = None
    scale_bar: str | None = None
    diameter: float | None = None
    filaments: Literal["auto", "bright", "dark"] = "auto"
    crop: tuple[int, int, int, int] | None = None
    force: bool = False


@dataclass(frozen=True)
class Micrograph:
    """Filaments of a picture: ``centres`` (n, 2) um of y (right) and z (up), ``diameter`` (n,) um, ``detection`` in
    pixels of the cropped picture, ``summary`` as in summary.json, ``out`` the folder."""

    out: Path
    centres: FloatArray
    diameter: FloatArray
    detection: Detection
    summary: dict[str, Any]


def options_from_text(
    out: Path,
    pixels_per_um: float | None,
    scale_bar: str | None,
    diameter: str | None,
    filaments: str,
    crop: str | None,
    force: bool,
) -> MicrographOptions:
    """Options as the command line takes them; InputError for what does not parse."""
    corners = None
    if crop is not None:
        match = re.fullmatch(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*", crop)
        if match is None:
            raise InputError("--crop", crop, "left,top,right,bottom in pixels, such as 0,0,2000,1400")
        left, top, right, bottom = (int(g) for g in match.groups())
        corners = left, top, right, bottom
    size = None if diameter is None else units.parse(diameter, "um", "--diameter")
    polarity: Literal["auto", "bright", "dark"] = "auto"
    if filaments in ("bright", "dark"):
        polarity = "bright" if filaments == "bright" else "dark"
    return MicrographOptions(out, pixels_per_um, scale_bar, size, polarity, corners, force)


def default_out(image: Path) -> Path:
    """results/section-<name of the picture>, where the verb writes when no folder is given."""
    return Path("results") / f"section-{image.stem}"


def report_lines(found: Micrograph) -> list[str]:
    """What the command line prints."""
    s = found.summary
    cut = f", {s['n_cut_by_the_border']} of them cut by the border" if s["n_cut_by_the_border"] else ""
    lines = [f"{s['n_filaments']} {s['filaments_are']} filaments{cut}"]
    if s["diameter_um"]:
        lines[0] += f"; diameter {s['diameter_um']['mean']:.3g} +- {s['diameter_um']['sd']:.2g} um"
    if "fibre_volume_fraction_in_outline" in s:
        local = s["local_volume_fraction"]
        lines.append(
            f"fibre volume fraction {s['fibre_volume_fraction_in_outline']:.3f} inside their outline, "
            f"{local['mean']:.3f} +- {local['sd']:.2g} round a filament"
        )
    start = s["to_start_a_run"]
    moved = (
        f"{start['n_moved']} centres move by up to {start['largest_shift_um']:.2g} um to clear overlaps"
        if start["n_moved"]
        else "no two filaments overlap"
    )
    lines.append(f"with filaments of {start['diameter_um']:g} um {moved}: cgfibre run {found.out / 'scene.toml'}")
    lines += [f"warning: {w}" for w in s["warnings"]]
    lines += [f"{name.partition('.')[0]:11s} {found.out / name}" for name in FILES]
    return lines


def read_picture(path: Path) -> Picture:
    """Grey values (rows, columns) float32 of a picture file (PNG, TIFF, JPEG, BMP ...; colours by their luminance).

    InputError for what is no picture or has more than :data:`MOST_PIXELS`.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # a bound of our own follows
            with Image.open(path) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise InputError("IMAGE", str(path), f"at most {MOST_PIXELS:.0e} pixels; cut it into parts")
                grey = image.mode in ("L", "F", "I", "I;16", "I;16B", "I;16L")
                return np.asarray(image if grey else image.convert("RGB").convert("L"), dtype=np.float32)
    except (UnidentifiedImageError, SyntaxError, ValueError):
        raise InputError("IMAGE", str(path), "a picture such as PNG, TIFF or JPEG") from None
    except Image.DecompressionBombError:
        raise InputError("IMAGE", str(path), f"at most {MOST_PIXELS:.0e} pixels; cut it into parts") from None
    except OSError as error:
        reason = (error.strerror or "it is damaged").lower()
        raise InputError("IMAGE", str(path), f"a picture that can be read ({reason})") from None


def read_micrograph(path: Path, options: MicrographOptions) -> Micrograph:
    """Find the filaments of a picture and write :data:`FILES` into ``options.out``.

    Raises InputError, before anything is written, for the picture, the options or an ``out`` that holds results.
    """
    picture = read_picture(path)
    store.check_folder(options.out, FILES, options.force)
    picture, scale = _scaled(picture, options)
    view = _cropped(picture, options.crop)
    if options.diameter is not None and not options.diameter > 0:
        raise InputError("--diameter", options.diameter, units.describe("um"))
    expected = None if options.diameter is None else options.diameter * scale
    detection = find_filaments(view, expected, options.filaments)
    centres, diameter = to_micrometres(detection.filaments, view.shape, scale)
    whole = ~detection.filaments.cut
    nominal = options.diameter or float(f"{np.mean(diameter[whole] if whole.any() else diameter):.4g}")
    summary = _summary(path, scale, detection, centres, diameter, nominal)
    options.out.mkdir(parents=True, exist_ok=True)
    store.write_columns(
        options.out / "centres.csv",
        {
            "y_um": centres[:, 0],
            "z_um": centres[:, 1],
            "diameter_um": diameter,
            "support": detection.filaments.support,
            "cut": detection.filaments.cut.astype(int),
        },
    )
    store.write_json(options.out / "summary.json", summary)
    (options.out / "scene.toml").write_text(_scene(path, nominal, centres), encoding="utf-8")
    finds = plot.Finds(view, detection.filaments.centres, detection.filaments.diameter, scale)
    plot.figure_finds(finds).savefig(options.out / "overlay.png")
    nearest = distribution.nearest_neighbour_distance(centres) / nominal if len(centres) > 1 else np.empty(0)
    statistics = plot.figure_histograms(
        [
            plot.Histogram(diameter, "Diameter (µm)"),
            plot.Histogram(nearest, "Nearest neighbour / diameter (1)"),
            plot.Histogram(_local_fraction(centres, diameter), "Local fibre volume fraction (1)"),
        ]
    )
    statistics.savefig(options.out / "statistics.png")
    return Micrograph(options.out, centres, diameter, detection, summary)


def _scaled(picture: Picture, options: MicrographOptions) -> tuple[Picture, float]:
    """(the picture, without the scale bar where that was looked for, pixels per um)."""
    given, bar = options.pixels_per_um, options.scale_bar
    if (given is None) == (bar is None):
        raise InputError("--pixels-per-um, --scale-bar", (given, bar), "one of them, such as 5.86, or '50 um'")
    if given is not None:
        if not (np.isfinite(given) and given > 0):
            raise InputError("--pixels-per-um", given, "a number above 0")
        return picture, given
    text, colon, pixels = str(bar).partition(":")
    length = units.parse(text, "um", "--scale-bar")
    if not length > 0:
        raise InputError("--scale-bar", bar, "a length above 0")
    if not colon:
        bar_found = find_scale_bar(picture)
        return bar_found.without, bar_found.length / length
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(?:px|pixels)?\s*", pixels)
    if match is None or float(match[1]) <= 0:
        raise InputError("--scale-bar", bar, "a length, and after a colon its pixels, such as '50 um:293'")
    return picture, float(match[1]) / length


def _cropped(picture: Picture, crop: tuple[int, int, int, int] | None) -> Picture:
    if crop is None:
        return picture
    left, top, right, bottom = crop
    height, width = picture.shape
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise InputError("--crop", crop, f"left,top,right,bottom inside the picture of {width} x {height} pixels")
    return picture[top:bottom, left:right]


def _local_fraction(centres: FloatArray, diameter: FloatArray) -> FloatArray:
    return distribution.local_volume_fraction(centres, diameter) if len(centres) > 2 else np.empty(0)


def _spread(values: FloatArray) -> dict[str, float]:
    return {"mean": float(np.mean(values)), "sd": float(np.std(values, ddof=1)) if len(values) > 1 else 0.0}


def _summary(
    path: Path, scale: float, detection: Detection, centres: FloatArray, diameter: FloatArray, nominal: float
) -> dict[str, Any]:
    n, whole = len(centres), ~detection.filaments.cut
    summary: dict[str, Any] = {
        "image": path.name,
        "pixels_per_um": scale,
        "filaments_are": detection.polarity,
        "n_filaments": n,
        "n_cut_by_the_border": int(np.sum(~whole)),
        "diameter_um": _spread(diameter[whole]) if whole.any() else None,
        "edge_support": _spread(detection.filaments.support),
        "area_fraction_of_picture": detection.area_fraction,
        "least_distance_over_diameter": min_distance(centres) / nominal if n > 1 else None,
    }
    if n >= 3:
        outline = distribution.polygon_area(distribution.outline(centres, diameter))
        summary["fibre_volume_fraction_in_outline"] = float(np.sum(np.pi * diameter**2 / 4)) / outline
        summary["local_volume_fraction"] = _spread(_local_fraction(centres, diameter))
        summary["nearest_neighbour_um"] = _spread(distribution.nearest_neighbour_distance(centres))
        summary["coordination_number"] = _spread(
            distribution.coordination_number(centres, nominal, 0.05 * nominal).astype(float)
        )
        fit = distribution.fit_distribution(centres, distribution.normalisation(centres, nominal))
        summary["normalised_coordinates"] = {k: v for k, v in asdict(fit).items() if k != "coordinates"}
    moved = separated(centres, nominal) - centres
    shift = np.hypot(moved[:, 0], moved[:, 1])
    summary["to_start_a_run"] = {
        "diameter_um": nominal,
        "n_moved": int(np.sum(shift > 1e-6 * nominal)),
        "rms_shift_um": float(np.sqrt(np.mean(shift**2))),
        "largest_shift_um": float(shift.max()),
    }
    weak = int(np.sum(detection.filaments.support < 0.5))
    warning = f"{weak} of {n} filaments show less than half of their edge: look at overlay.png"
    summary["warnings"] = [warning] if weak > 0.02 * n else []
    return summary


def _scene(path: Path, diameter: float, centres: FloatArray) -> str:
    """TOML of a section that starts from the centres found."""
    height = float(np.ptp(centres[:, 1])) + diameter
    stop = max(0.8 * height, 1.01 * diameter) if len(centres) > 1 else 0.8 * diameter
    name = re.sub(r"[^\w.-]+", "-", path.stem) or "micrograph"
    return f'''# Filaments found in {path.name}; change what is not so in your specimen, then: cgfibre run scene.toml
name = "{name}"
description = "{len(centres)} filaments found in a micrograph"

[filament]
material = "T700 carbon"
diameter = "{diameter:.4g} um"  # of every filament; overlaps of the centres are cleared with it

[assembly]
arrangement = "file"
centres = "centres.csv"
length = "0.7 mm"  # of the filaments: it sets the springs that hold the discs

[platens]
width = "0.5 mm"  # along the filaments
stop = {{ thickness = "{stop:.4g} um" }}  # the section is {height:.4g} um high

[model]
level = "section"  # or "chain", "rod"
'''
