"""Filaments in three dimensions: tubes with platens and a scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.plot import INK, STEEL, Colours, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class PlatenFace:
    """Face of a platen in the 3D view: height ``z`` um, if it is the top one, extents in x and y, um (inf: all)."""

    z: float
    above: bool
    x: tuple[float, float] = (-np.inf, np.inf)
    y: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True)
class BundleView:
    """What :func:`figure_bundle_3d` shows.

    ``values`` (n_filaments,) or (n_beads,) coloured on ``colours``; ``platens`` outlined; y and z (diameters included)
    drawn ``exaggeration`` times larger than x, and said so on the figure; ``azimuth`` and ``elevation`` in degrees of
    the eye about z and above the x-y plane (-90, 0 looks along y).
    """

    values: FloatArray | None = None
    colours: Colours | None = None
    platens: tuple[PlatenFace, ...] = ()
    exaggeration: float = 1.0
    azimuth: float = -62.0
    elevation: float = 20.0
    title: str = ""


@dataclass(frozen=True)
class Camera:
    """Parallel projection: rows right, up, towards the eye; y and z stretched before."""

    axes: FloatArray
    stretch: FloatArray

    @classmethod
    def of(cls, view: BundleView) -> Camera:
        """The camera of a view."""
        a, e = np.radians([view.azimuth, view.elevation])
        eye = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return cls(np.stack([right, np.cross(eye, right), eye]), np.array([1, view.exaggeration, view.exaggeration]))

    def __call__(self, points: FloatArray) -> FloatArray:
        """(n, 3) points as the camera sees them."""
        return (np.asarray(points, dtype=float) * self.stretch) @ self.axes.T


@dataclass(frozen=True)
class Tubes:
    """Points close together along the filaments, (n, 3) as the camera sees them, with tangent and (n,) radius."""

    points: FloatArray
    tangent: FloatArray
    radius: FloatArray
    bead: IntArray
    filament: IntArray


#: pixels touched at most (a second or so); larger systems are drawn coarser
PIXEL_BUDGET = 16_000_000


def _tubes(system: FilamentSystem, positions: FloatArray, camera: Camera, step: float) -> Tubes:
    bonds = system.bonds()
    bonds = bonds[bonds[:, 1] > bonds[:, 0]]  # a closing bond would cross the picture
    seen = camera(positions)
    d = seen[bonds[:, 1]] - seen[bonds[:, 0]]
    length = np.linalg.norm(d, axis=1)
    n = np.maximum(1, np.ceil(np.linalg.norm(d[:, :2], axis=1) / step)).astype(np.int64)
    bond = np.repeat(np.arange(len(bonds)), n)
    share = (np.arange(len(bond)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[bond]
    return Tubes(
        points=seen[bonds[bond, 0]] + share[:, None] * d[bond],
        tangent=(d / np.where(length > 0, length, 1.0)[:, None])[bond],
        radius=np.full(len(bond), float(system.diameter.mean()) / 2 * float(camera.stretch[1])),
        bead=bonds[bond, 0] + (share > 0.5),
        filament=system.filament_of_bead[bonds[bond, 0]],
    )


def render_tubes(
    tubes: Tubes, base: FloatArray, origin: FloatArray, shape: tuple[int, int], pixel: float
) -> FloatArray:
    """(rows, columns, 4) image of shaded tubes by a depth buffer: every point is a ball, shaded as its tube."""
    rows, columns = shape
    place = (tubes.points[:, :2] - origin) / pixel
    corner = np.floor(place).astype(np.int64)
    r = tubes.radius / pixel
    largest = float(r.max())
    reach = int(np.ceil(largest))
    offsets = np.array([(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)])
    depth = tubes.points[:, 2] / pixel
    depth = depth - depth.min() + largest + 1
    # depth in the high bits, then the point: the largest is what the eye meets
    levels = (2.0**30) / (depth.max() + largest + 1)
    nearest = np.zeros(rows * columns, dtype=np.int64)
    index = np.arange(len(place), dtype=np.int64)
    for i, j in offsets:
        at = corner + np.array((i, j))
        dx, dy = at[:, 0] + 0.5 - place[:, 0], at[:, 1] + 0.5 - place[:, 1]
        lift = r * r - dx * dx - dy * dy
        use = (lift > 0) & (at[:, 0] >= 0) & (at[:, 0] < columns) & (at[:, 1] >= 0) & (at[:, 1] < rows)
        height = depth[use] + np.sqrt(lift[use])
        key = ((height * levels).astype(np.int64) << 32) | index[use]
        np.maximum.at(nearest, at[use, 1] * columns + at[use, 0], key)
    hit = np.flatnonzero(nearest)
    point = nearest[hit] & 0xFFFFFFFF
    normal = np.empty((len(hit), 3))
    normal[:, 0] = (hit % columns + 0.5 - place[point, 0]) / r[point]
    normal[:, 1] = (hit // columns + 0.5 - place[point, 1]) / r[point]
    normal[:, 2] = np.sqrt(np.maximum(1 - normal[:, 0] ** 2 - normal[:, 1] ** 2, 0))
    tangent = tubes.tangent[point]
    normal -= (normal * tangent).sum(axis=1, keepdims=True) * tangent
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    light = np.array([-0.35, 0.75, 0.56])
    halfway = light + np.array([0, 0, 1])
    halfway /= np.linalg.norm(halfway)
    diffuse = np.clip(normal @ light, 0, 1)
    shine = np.clip(normal @ halfway, 0, 1) ** 28
    # a dark rim parts one filament from the next, a jump in depth deepens it
    surface = (nearest >> 32).reshape(shape) / levels
    fall = np.zeros(shape)
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        fall = np.maximum(fall, np.roll(surface, shift, axis) - surface)
    shadow = 1 - 0.5 * np.clip(fall.ravel()[hit] / (2 * r[point]), 0, 1)
    bright = (0.38 + 0.72 * diffuse) * (0.55 + 0.45 * normal[:, 2]) * shadow
    image = np.zeros((rows * columns, 4))
    image[hit, :3] = np.clip(base[point] * bright[:, None] + 0.22 * (shine * shadow)[:, None], 0, 1)
    image[hit, 3] = 1
    return image.reshape(rows, columns, 4)


def _draw_platens(ax: Axes, view: BundleView, camera: Camera, positions: FloatArray, depth: float) -> FloatArray:
    """Draw the outlines; (n, 3) their corners."""
    from matplotlib.patches import Polygon

    drawn = np.empty((0, 3))

    low, high = positions.min(axis=0), positions.max(axis=0)
    margin = 0.06 * max(high[1] - low[1], high[2] - low[2], 1e-9)
    for face in view.platens:
        x = np.clip(face.x, low[0] - margin, high[0] + margin)
        y = np.clip(face.y, low[1] - 2 * margin, high[1] + 2 * margin)
        back = face.z + (depth if face.above else -depth)
        ring = np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])
        lower, upper = (np.column_stack([ring, np.full(4, z)]) for z in sorted((face.z, back)))
        sides = [np.array([lower[k], lower[(k + 1) % 4], upper[(k + 1) % 4], upper[k]]) for k in range(4)]
        centre = (lower.mean(axis=0) + upper.mean(axis=0)) / 2
        for quad in (lower, upper, *sides):
            drawn = np.concatenate([drawn, quad])
            outward = (quad.mean(axis=0) - centre) @ camera.axes[2]
            front = outward > 0
            if not front and not (face.above and quad is lower):
                continue
            ax.add_patch(
                Polygon(
                    camera(quad)[:, :2],
                    facecolor=(0.62, 0.66, 0.70, 0.16 if face.above else 0.35),
                    edgecolor=(0.2, 0.22, 0.25, 0.75),
                    lw=0.9,
                    zorder=3 if face.above else 1,
                    joinstyle="round",
                )
            )
    return drawn


def _draw_scale(ax: Axes, view: BundleView, camera: Camera, points: FloatArray) -> FloatArray:
    """Bar of a round length along x below everything at ``points`` (n, 3), the axes beside it; (n, 2) points drawn."""
    low, high = points.min(axis=0), points.max(axis=0)
    seen = camera(points)[:, :2]
    size = float(np.ptp(seen[:, 0]))
    along = camera.axes[:2, 0]
    nice = 10 ** np.floor(np.log10((high[0] - low[0]) / 3))
    bar = nice * max(k for k in (1, 2, 5) if k == 1 or k * nice <= (high[0] - low[0]) / 3)
    near = camera(low)[:2] - [0, 0.03 * size]
    ends = np.array([near, near + bar * along])
    ax.plot(ends[:, 0], ends[:, 1], color=INK, lw=3, solid_capstyle="butt", zorder=4)
    words = f"{bar:g} µm along x" if bar < 1000 else f"{bar / 1000:g} mm along x"
    if view.exaggeration != 1:
        words += f"; y and z drawn {view.exaggeration:g} times larger"
    ax.annotate(
        words,
        (near[0], near[1]),
        (0, -6),
        textcoords="offset points",
        ha="left",
        va="top",
        rotation=float(np.degrees(np.arctan2(along[1], along[0]))),
        rotation_mode="anchor",
    )
    arrow = 0.055 * size
    root = np.array([seen[:, 0].max() + 0.02 * size, seen[:, 1].min() + 0.3 * arrow])
    tips = root + arrow * camera.axes[:2].T
    for tip, name in zip(tips, "xyz", strict=True):
        arrowprops = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", (tip[0], tip[1]), (root[0], root[1]), arrowprops=arrowprops)
        out = root + 1.3 * (tip - root)
        ax.text(out[0], out[1], name, ha="center", va="center", style="italic")
    return np.concatenate([ends, tips])


def figure_bundle_3d(system: FilamentSystem, positions: FloatArray, view: BundleView | None = None) -> Figure:
    """The filaments as shaded tubes in parallel projection, hidden parts hidden, with the platens' outline.

    ``positions`` (n_beads, 3) um. True to scale unless ``view.exaggeration`` says otherwise. A bond that closes a
    periodic filament is not drawn. Raises InputError for sections, non-finite positions or values of another length.
    """
    from matplotlib.colors import to_rgb

    view = view or BundleView()
    if not len(system.bonds()):
        raise InputError("system", "one bead a filament", "filaments of two beads or more (draw sections in 2D)")
    if positions.shape != (system.n_beads, 3) or not np.all(np.isfinite(positions)):
        raise InputError("positions", positions.shape, f"shape ({system.n_beads}, 3), finite")
    camera = Camera.of(view)
    radius = float(system.diameter.mean()) / 2 * view.exaggeration
    seen = camera(positions)[:, :2]
    low, high = seen.min(axis=0) - 1.5 * radius, seen.max(axis=0) + 1.5 * radius
    pixel = float((high[0] - low[0]) / 2100)
    bonds = system.bonds()
    run = float(np.linalg.norm(seen[bonds[:, 1]] - seen[bonds[:, 0]], axis=1).sum())
    for _ in range(8):
        step = max(0.5 * radius, pixel)
        if run / step * (2 * np.ceil(radius / pixel) + 1) ** 2 <= PIXEL_BUDGET:
            break
        pixel *= 1.25
    tubes = _tubes(system, positions, camera, step)
    colours = view.colours
    if view.values is None:
        # slightly different greys tell neighbours apart
        tone = 0.88 + 0.24 * np.modf(np.arange(system.n_filaments) * 0.618)[0]
        base = np.asarray(to_rgb(STEEL)) * tone[tubes.filament][:, None]
    else:
        values = np.asarray(view.values, dtype=float)
        if values.shape not in ((system.n_filaments,), (system.n_beads,)):
            raise InputError("view.values", values.shape, f"{system.n_filaments} or {system.n_beads} values")
        colours = colours or Colours.spanning("", values)
        each = values[tubes.bead] if values.shape == (system.n_beads,) else values[tubes.filament]
        base = np.asarray(colours.mappable().to_rgba(each))[:, :3]
    shape = (int(np.ceil((high[1] - low[1]) / pixel)), int(np.ceil((high[0] - low[0]) / pixel)))
    image = render_tubes(tubes, base, low, shape, pixel)

    fig = new_figure(10.0, 4.0)
    with style():
        ax = fig.add_subplot()
        extent = (low[0], low[0] + shape[1] * pixel, low[1], low[1] + shape[0] * pixel)
        ax.imshow(image, origin="lower", extent=extent, interpolation="antialiased", zorder=2)
        corners = positions.min(axis=0), positions.max(axis=0)
        faces = _draw_platens(ax, view, camera, positions, depth=0.22 * float((corners[1] - corners[0])[1:].max()))
        points = np.concatenate([faces, positions])
        scale = _draw_scale(ax, view, camera, points)
        drawn = np.concatenate([scale, camera(points)[:, :2], [low, high]])
        ax.set_aspect("equal")
        ax.set_axis_off()
        if view.title:
            ax.set_title(view.title)
        pad = 0.02 * float(np.ptp(drawn[:, 0]))
        ax.set_xlim(drawn[:, 0].min() - pad, drawn[:, 0].max() + 2 * pad)
        ax.set_ylim(drawn[:, 1].min() - 2 * pad, drawn[:, 1].max() + pad)
        (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
        fig.set_size_inches(10.0, float(np.clip(9.2 * (y1 - y0) / (x1 - x0) + 0.5, 2.4, 8.0)))
        if view.values is not None and colours is not None:
            bar = fig.colorbar(colours.mappable(), ax=ax, shrink=0.75, pad=0.01, aspect=20)
            bar.set_label(colours.label, labelpad=7)
            bar.outline.set_visible(False)
    return fig
