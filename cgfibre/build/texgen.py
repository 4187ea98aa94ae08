"""Textiles from TexGen: yarn paths and sections of .tg3 files (XML), and of pytexgen's objects where it is installed.

A path is what TexGen makes of a yarn's master nodes (Interpolation.cpp, InterpolationBezier.cpp, InterpolationCubic.cpp
of TexGen 3): cubic Bezier curves with control points a third of the nodes' distance along their tangents, cubic splines
over the nodes' numbers (periodic or natural), or straight lines; the section's thickness follows the nodes' "up".
Yarns are repeated to fill one cell, shifted so that its corner is the origin and the fabric's middle is at z = 0.
"""

from __future__ import annotations

import importlib
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from cgfibre.build.system import FloatArray
from cgfibre.build.tow_path import TowPath
from cgfibre.build.tow_shape import Section, TowShape
from cgfibre.errors import InputError

#: um of TexGen's unit of length
SCALES = {"m": 1e6, "cm": 1e4, "mm": 1e3, "um": 1.0, "micron": 1.0, "nm": 1e-3}
#: points of a path between two master nodes
POINTS = 200
#: of the cell: nearness that counts as equal
CLOSE = 1e-6


@dataclass(frozen=True)
class Textile:
    """What was read: tows, warp (along x) first; ``cell`` (x, y) um, ``None`` without repeats; what was simplified.

    ``(textile.paths, textile.cell)`` is what :mod:`cgfibre.build.weave` builds from.
    """

    name: str
    paths: tuple[TowPath, ...]
    cell: tuple[float, float] | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Yarn:
    points: FloatArray
    tangent: FloatArray
    normal: FloatArray
    shape: TowShape
    repeats: FloatArray


def textile_from_file(path: str | Path, name: str | None = None) -> Textile:
    """The textile called ``name`` of a .tg3 file, or the only one.

    Raises :class:`InputError` as :func:`textile_from_xml`, and for a file that cannot be read.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("texgen.file", str(path), f"a readable .tg3 file ({error})") from error
    return textile_from_xml(text, name)


def textile_from_object(textile: Any) -> Textile:
    """A textile of pytexgen (``CTextile`` and all made from it); needs the optional package pytexgen.

    TexGen writes it as XML, which :func:`textile_from_xml` reads. Raises :class:`InputError` without pytexgen.
    """
    try:
        texgen = importlib.import_module("pytexgen")
    except ImportError as error:
        raise InputError("texgen", "pytexgen", "the package, which is not installed: pip install pytexgen") from error
    name = "cgfibre-import"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "textile.tg3"
        texgen.AddTextile(name, textile, True)
        try:
            texgen.SaveToXML(str(file), name, texgen.OUTPUT_STANDARD)
        finally:
            texgen.DeleteTextile(name)
        return textile_from_file(file, name)


def textile_from_xml(text: str, name: str | None = None) -> Textile:
    """The textile of the text of a .tg3 file.

    Read are yarns with Bezier, cubic or linear interpolation (others where the file has their slave nodes: full
    output), elliptic, lenticular, rectangular, power-ellipse and polygon sections, constant or interpolated along the
    yarn (its mean then), and repeats along x and y. A section that is none of ours becomes the one of equal width and
    thickness whose area is nearest; ``notes`` say so.
    Raises :class:`InputError` for anything else, for a model saved without its yarns (minimal output), and for yarns
    that end inside a periodic cell.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError("texgen", "text", f"the XML of a .tg3 file ({error})") from error
    found = {t.get("name", ""): t for t in root.iter("Textile")}
    if name is None and len(found) == 1:
        name = next(iter(found))
    if name not in found:
        raise InputError(
            "texgen.textile", name, "one of " + ", ".join(sorted(found)) if found else "a file with textiles"
        )
    element = found[name]
    unit = element.get("GeometryScale", "mm")
    if unit not in SCALES:
        raise InputError("texgen.GeometryScale", unit, "one of " + ", ".join(SCALES))
    yarns = element.findall("Yarn")
    if not yarns:
        raise InputError("texgen.textile", name, "yarns: save it with standard or full output")
    notes: list[str] = []
    read = [_yarn(y, SCALES[unit], notes) for y in yarns]
    cell = _cell(read)
    tows = [tow for yarn in read for tow in _in_cell(yarn, cell, _corner(element, SCALES[unit]))]
    return Textile(name, _ordered(tows), cell, tuple(dict.fromkeys(notes)))


def _vector(text: str | None) -> FloatArray:
    return np.array([float(v) for v in (text or "").split(",")])


def _yarn(element: ET.Element, scale: float, notes: list[str]) -> _Yarn:
    points, tangent, up = _line(element)
    shape, upright = _shape(element, scale, notes)
    normal = up - np.sum(up * tangent, axis=1)[:, None] * tangent
    length = np.linalg.norm(normal, axis=1)
    if np.min(length) < 1e-6:
        raise InputError("texgen.Up", "parallel to the yarn", "a direction across the yarn")
    normal /= length[:, None]
    if upright:
        normal = np.cross(normal, tangent)
    repeats = np.array([_vector(r.get("value")) for r in element.findall("Repeat")]).reshape(-1, 3)
    return _Yarn(points * scale, tangent, normal, shape, repeats * scale)


def _line(element: ET.Element) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n, 3) points, unit tangents and up vectors of a yarn."""
    nodes = sorted(element.findall("MasterNode"), key=lambda n: int(n.get("index", 0)))
    if len(nodes) < 2:
        raise InputError("texgen.MasterNode", len(nodes), "two nodes a yarn at least")
    if any(float(n.get("Angle", 0.0)) != 0.0 for n in nodes):
        raise InputError("texgen.Angle", [n.get("Angle") for n in nodes], "0: turned sections are not read")
    p, given, up = (np.array([_vector(n.get(key)) for n in nodes]) for key in ("Position", "Tangent", "Up"))
    up[~np.any(up, axis=1), 2] = 1.0
    how = element.find("Interpolation")
    kind = "CInterpolationBezier" if how is None else how.get("type", "CInterpolationBezier")
    periodic, flat = (how is not None and how.get(key) == "1" for key in ("Periodic", "ForceMasterNodeTangent"))
    n = len(p)
    index = np.repeat(np.arange(n - 1), POINTS)
    t = np.tile(np.arange(POINTS) / POINTS, n - 1)
    index, t = np.append(index, n - 2), np.append(t, 1.0)
    if kind == "CInterpolationBezier":
        points, slope = _bezier(p, given, periodic, flat, index, t)
    elif kind == "CInterpolationCubic":
        drift = np.outer(np.arange(n), (p[-1] - p[0]) / (n - 1)) if periodic else np.zeros_like(p)
        knots = p - drift
        if periodic:
            knots[-1] = knots[0]
        spline = CubicSpline(np.arange(n), knots, bc_type="periodic" if periodic else "natural")
        line = (p[-1] - p[0]) / (n - 1) if periodic else np.zeros(3)
        points = spline(index + t) + np.outer(index + t, line)
        slope = spline(index + t, 1) + line
    elif kind == "CInterpolationLinear":
        slope = np.diff(p, axis=0)[index]
        points = p[index] + t[:, None] * slope
    else:
        return _slave_nodes(element, kind)
    return points, slope / np.linalg.norm(slope, axis=1)[:, None], up[index] + t[:, None] * (up[index + 1] - up[index])


def _slave_nodes(element: ET.Element, kind: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    nodes = element.findall("SlaveNode")
    if len(nodes) < 2:
        raise InputError("texgen.Interpolation", kind, "a Bezier, cubic or linear one, or a file with slave nodes")
    p, tangent, up = (np.array([_vector(n.get(key)) for n in nodes]) for key in ("Position", "Tangent", "Up"))
    return p, tangent / np.linalg.norm(tangent, axis=1)[:, None], up


def _bezier(
    p: FloatArray, given: FloatArray, periodic: bool, flat: bool, index: np.ndarray, t: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points and derivatives; a node without a tangent takes the direction from its neighbour to the next."""
    before, after = np.vstack([p[:1], p[:-1]]), np.vstack([p[1:], p[-1:]])
    if periodic:
        span = p[-1] - p[0]
        before[0], after[-1] = p[-2] - span, p[1] + span
    tangent = after - before
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    tangent = np.where(np.any(given, axis=1)[:, None], given, tangent)
    if flat:
        tangent[:, 2] = 0.0
    third = np.linalg.norm(np.diff(p, axis=0), axis=1)[:, None] / 3.0
    a, d = p[:-1][index], p[1:][index]
    b, c = a + (tangent[:-1] * third)[index], d - (tangent[1:] * third)[index]
    t, s = t[:, None], 1.0 - t[:, None]
    points = s**3 * a + 3.0 * s**2 * t * b + 3.0 * s * t**2 * c + t**3 * d
    return points, s**2 * (b - a) + 2.0 * s * t * (c - b) + t**2 * (d - c)


def _shape(element: ET.Element, scale: float, notes: list[str]) -> tuple[TowShape, bool]:
    """The section, and whether its longer side is the one along "up"."""
    along = element.find("YarnSection")
    found = [] if along is None else [s for s in along.iter("Section") if s.get("type")]
    if not found:
        raise InputError("texgen.YarnSection", None, "a section a yarn")
    sizes = np.array([_size(s) for s in found])
    width, height, area = sizes.mean(axis=0)
    if np.any(np.ptp(sizes[:, :2], axis=0) > 0.01 * sizes[:, :2].mean(axis=0)):
        notes.append("sections that change along a yarn were taken as their mean")
    kinds = {str(s.get("type")) for s in found}
    upright = height > width * (1.0 + 1e-9)
    w, t = (height, width) if upright else (width, height)
    ours: dict[str, Section] = {
        "CSectionEllipse": "circular" if abs(w - t) < 1e-9 * w else "elliptic",
        "CSectionLenticular": "lenticular",
        "CSectionRectangle": "rectangular",
    }
    # an upright lens keeps its tips at its narrow sides only as another figure: nearest area as well
    if len(kinds) == 1 and kinds <= set(ours) and not (upright and kinds == {"CSectionLenticular"}):
        section = ours[kinds.pop()]
    else:
        choice: tuple[Section, ...] = ("lenticular", "elliptic", "racetrack", "rectangular")
        section = min(choice, key=lambda s: abs(TowShape(s, w, t).area - area))
        fitted = TowShape(section, w, t).area
        notes.append(
            f"{', '.join(sorted(kinds))} {w * scale:.5g} x {t * scale:.5g} um taken as {section}: "
            f"area {fitted * scale**2:.5g} for {area * scale**2:.5g} um2"
        )
    return TowShape(section, float(w * scale), float((w if section == "circular" else t) * scale)), bool(upright)


def _size(section: ET.Element) -> tuple[float, float, float]:
    """Width, height and area of a section element."""
    kind = section.get("type")
    if kind == "CSectionPolygon":
        outline = np.array([_vector(e.get("value")) for e in section.findall("PolygonPoint")])
        if len(outline) < 3:
            raise InputError("texgen.Section", kind, "three points of a polygon at least")
    elif kind == "CSectionPowerEllipse":
        width, height, power, x = (float(section.get(k, 0.0)) for k in ("Width", "Height", "Power", "XOffset"))
        a = 2.0 * np.pi * np.arange(2000) / 2000
        half = np.where(np.cos(a) >= 0.0, 0.5 * width - x, 0.5 * width + x)
        outline = np.column_stack(
            [half * np.cos(a) + x, 0.5 * height * np.sign(np.sin(a)) * np.abs(np.sin(a)) ** power]
        )
    elif kind in ("CSectionEllipse", "CSectionLenticular", "CSectionRectangle"):
        if float(section.get("Distortion", 0.0)) != 0.0:
            raise InputError("texgen.Distortion", section.get("Distortion"), "0: distorted lenses are not read")
        width, height = float(section.get("Width", "nan")), float(section.get("Height", "nan"))
        if not (width > 0.0 and height > 0.0):
            raise InputError("texgen.Section", (width, height), "a width and a height above 0")
        ours: Section = "lenticular" if kind == "CSectionLenticular" else "elliptic"
        area = TowShape(ours, max(width, height), min(width, height)).area
        return width, height, width * height if kind == "CSectionRectangle" else area
    else:
        raise InputError("texgen.Section", kind, "CSectionEllipse, -Lenticular, -Rectangle, -PowerEllipse or -Polygon")
    y, z = outline.T
    area = 0.5 * abs(float(np.sum(y * np.roll(z, -1) - np.roll(y, -1) * z)))
    return float(np.ptp(y)), float(np.ptp(z)), area


def _repeat(yarn: _Yarn, axis: int) -> float:
    """Length in um of the yarn's repeat along an axis, 0 without one."""
    other = [k for k in range(3) if k != axis]
    along = [abs(r[axis]) for r in yarn.repeats if np.all(np.abs(r[other]) <= CLOSE * np.abs(r[axis]))]
    return max(along, default=0.0)


def _cell(yarns: Sequence[_Yarn]) -> tuple[float, float] | None:
    """The cell that all repeats fit, or ``None`` where there are no repeats."""
    if not any(len(y.repeats) for y in yarns):
        return None
    size = [max(_repeat(y, axis) for y in yarns) for axis in (0, 1)]
    for yarn in yarns:
        for axis, length in enumerate(size):
            own = _repeat(yarn, axis)
            if own == 0.0 or abs(length / own - round(length / own)) > CLOSE:
                expected = f"a repeat along {'xy'[axis]} of every yarn that divides {length:g} um"
                raise InputError("texgen.Repeat", yarn.repeats.tolist(), expected)
    return float(size[0]), float(size[1])


def _corner(element: ET.Element, scale: float) -> FloatArray:
    """(2,) um, lower corner in x and y of the domain, or the origin."""
    corner = np.zeros(2)
    for plane in element.iterfind("Domain/Plane"):
        normal = _vector(plane.get("Normal"))
        for axis in (0, 1):
            if normal[axis] > 1.0 - 1e-9:
                corner[axis] = float(plane.get("d", 0.0)) * scale
    return corner


def _in_cell(yarn: _Yarn, cell: tuple[float, float] | None, corner: FloatArray) -> list[TowPath]:
    """The yarn's images in one cell; each begins where the cell does."""
    span = yarn.points[-1] - yarn.points[0]
    axis = 0 if abs(span[0]) >= abs(span[1]) else 1
    points, tangent, normal = yarn.points, yarn.tangent, yarn.normal
    points = points - np.array([*corner, 0.0])
    if span[axis] < 0.0:
        points, tangent, normal, span = points[::-1], -tangent[::-1], normal[::-1], -span
    if cell is None:
        return [TowPath(points, tangent, normal, yarn.shape, False, axis == 0, 0)]
    length, step = cell[axis], _repeat(yarn, axis)
    copies = span / np.array([cell[0], cell[1], 1.0])
    if (
        abs(span[axis] - step) > CLOSE * step
        or abs(span[2]) > CLOSE * step
        or (abs(copies[1 - axis] - round(copies[1 - axis])) > CLOSE)
    ):
        raise InputError("texgen.yarn", span.tolist(), f"a yarn as long as its repeat, {step:g} um along {'xy'[axis]}")
    n = round(length / step)
    points = np.concatenate([*(points[:-1] + k * span for k in range(n)), points[-1:] + (n - 1) * span])
    tangent, normal = (np.concatenate([np.tile(v[:-1], (n, 1)), v[-1:]]) for v in (tangent, normal))
    whole = n * span
    u = points[:, axis]
    target = np.ceil(u[0] / length - CLOSE) * length
    if target - u[0] > CLOSE * length:
        path = TowPath(points, tangent, normal, yarn.shape, True, axis == 0, 0)
        k = int(np.argmax(u >= target))
        s = path.arc[k - 1] + (path.arc[k] - path.arc[k - 1]) * (target - u[k - 1]) / (u[k] - u[k - 1])
        cut = path.at(np.array([s]))
        rest = k + (u[k] - target <= CLOSE * length)
        points, tangent, normal = (
            np.concatenate([c, v[rest:-1], v[:k] + (whole if first else 0.0), c + (whole if first else 0.0)])
            for c, v, first in zip(cut, (points, tangent, normal), (True, False, False), strict=True)
        )
    shift = np.zeros(3)
    shift[axis] = -target
    other, wide = 1 - axis, cell[1 - axis]
    own = _repeat(yarn, other)
    shift[other] = -np.floor(points[:, other].mean() / own + CLOSE) * own
    tows = []
    for k in range(round(wide / own)):
        shift_k = shift.copy()
        shift_k[other] += k * own
        tows.append(TowPath(points + shift_k, tangent, normal, yarn.shape, True, axis == 0, 0))
    return tows


def _ordered(tows: list[TowPath]) -> tuple[TowPath, ...]:
    """Warp tows first, each kind by place; the middle at z = 0; numbered, and their crossings found."""
    low = min(float(np.min(t.points[:, 2])) - 0.5 * t.shape.thickness for t in tows)
    high = max(float(np.max(t.points[:, 2])) + 0.5 * t.shape.thickness for t in tows)
    tows = [t.moved(np.array([0.0, 0.0, -0.5 * (low + high)])) for t in tows]

    def place(tow: TowPath) -> float:
        return float(np.mean(tow.points[:, 1 if tow.is_warp else 0]))

    tows.sort(key=lambda t: (not t.is_warp, round(place(t), 6), float(np.mean(t.points[:, 2]))))
    result = []
    for index, tow in enumerate(tows):
        u = tow.points[:, 0 if tow.is_warp else 1]
        at = np.unique(np.round([place(t) for t in tows if t.is_warp != tow.is_warp], 6))
        inside = at[(at >= u[0]) & (at < u[-1])] if len(at) else at
        # a yarn that turns back crosses where it likes: no beads are put there
        crossings = np.interp(inside, u, tow.arc) if np.all(np.diff(u) > 0.0) else np.zeros(0)
        result.append(replace(tow, index=index, crossings=crossings))
    return tuple(result)
