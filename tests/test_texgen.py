"""Textiles of TexGen: a file that pytexgen made, every interpolation against its definition, what is refused."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from cgfibre.build import texgen
from cgfibre.build.bundle import filament_type
from cgfibre.build.texgen import textile_from_file, textile_from_object, textile_from_xml
from cgfibre.build.weave import TowShape, WeaveSpec, initial_overlap, plain, tow_system, weave_paths
from cgfibre.errors import InputError

FILE = ROOT / "tests" / "data" / "plain.tg3"  # CTextileWeave2D(2, 2, 1.0, 0.4): yarns 0.4 x 0.2 mm


def model(interpolation, nodes, section='type="CSectionEllipse" Width="0.8" Height="0.2"', repeats=((4, 0), (0, 3))):
    """A yarn as TexGen writes it, mm."""
    vector = "{}, {}, {}".format
    return (
        '<TexGenModel version="3.14.0"><Textile name="t" GeometryScale="mm"><Yarn index="0">'
        f'<Interpolation {interpolation} /><YarnSection type="CYarnSectionConstant"><Section {section} /></YarnSection>'
        + "".join(f'<Repeat value="{x}, {y}, 0" />' for x, y in repeats)
        + "".join(
            f'<MasterNode index="{k}" Position="{vector(*p)}" Tangent="0, 0, 0" Up="0, 0, 1" Angle="0" />'
            for k, p in enumerate(nodes)
        )
        + "</Yarn></Textile></TexGenModel>"
    )


NODES = ((0, 1, 0), (1, 1, 0.3), (2.5, 1, -0.2), (4, 1, 0))


def test_a_plain_weave_is_the_one_built_here():
    textile = textile_from_file(FILE)
    assert textile.cell == pytest.approx((2000.0, 2000.0)) and textile.notes == ()
    tow = TowShape("elliptic", 400.0, 200.0)
    ours = weave_paths(WeaveSpec(~plain(), tow, tow, 1000.0, 1000.0))
    assert [p.is_warp for p in textile.paths] == [p.is_warp for p in ours]
    for a, b in zip(textile.paths, ours, strict=True):
        axis = 0 if a.is_warp else 1
        assert a.shape == b.shape and a.closed and a.index == b.index
        assert a.points[[0, -1], axis] == pytest.approx([0.0, 2000.0], abs=1e-6)
        u = np.linspace(0.0, 2000.0, 301)
        z, expected = (np.interp(u, p.points[:, axis], p.points[:, 2]) for p in (a, b))
        # half a cosine against TexGen's Bezier curve: a hundredth of the thickness
        assert np.abs(z - expected).max() < 0.012 * 200.0
        assert a.points[:, 1 - axis] == pytest.approx(b.points[0, 1 - axis])
        assert a.arc_length == pytest.approx(b.arc_length, rel=2e-3)
        assert a.crossings == pytest.approx(b.crossings, rel=5e-3)


def test_it_builds_as_a_weave_does():
    textile = textile_from_file(FILE)
    kind = filament_type(200.0, 1e6, 4e5, 1.0)
    system = tow_system((textile.paths, textile.cell), kind, 50.0)
    assert initial_overlap(system)[0] <= 1e-6 * 200.0
    assert 1.0 <= system.provenance["height_stretch"] < 1.02
    assert system.closed.all() and system.box[:2].tolist() == [[0.0, 2000.0], [0.0, 2000.0]]


def test_straight_and_cubic_lines_go_through_the_nodes():
    for kind in ("CInterpolationLinear", "CInterpolationCubic", "CInterpolationBezier"):
        path = textile_from_xml(model(f'Periodic="1" type="{kind}"', NODES)).paths[0]
        knots = np.array(NODES) * 1e3
        z = np.interp(knots[:-1, 0], path.points[:, 0], path.points[:, 2])
        # the fabric's middle is at z = 0: a constant between
        assert z - knots[:-1, 2] == pytest.approx(z[0], abs=0.05)
        assert path.closed and path.points[0, 1] == pytest.approx(1000.0)
        if kind == "CInterpolationLinear":
            assert path.arc_length == pytest.approx(np.linalg.norm(np.diff(knots, axis=0), axis=1).sum())
        else:
            assert path.tangent[0] == pytest.approx(path.tangent[-1], abs=1e-9)  # smooth through the boundary
            assert np.abs(np.diff(path.tangent, axis=0)).max() < 0.02


def test_bezier_of_forced_flat_tangents():
    """Control points a third of the nodes' distance away: z = 3 h t^2 - 2 h t^3 between nodes of flat tangents."""
    nodes = ((0, 0, 0), (2, 0, 0.5), (4, 0, 0))
    text = model('Periodic="1" ForceMasterNodeTangent="1" type="CInterpolationBezier"', nodes)
    path = textile_from_xml(text).paths[0]
    t = np.arange(texgen.POINTS) / texgen.POINTS
    z = path.points[: texgen.POINTS, 2] - path.points[0, 2]
    assert z == pytest.approx(500.0 * (3.0 * t**2 - 2.0 * t**3), abs=1e-9)


def test_yarns_are_repeated_into_one_cell():
    half = model(
        'Periodic="1" type="CInterpolationLinear"', ((1, 1, 0), (2, 1, 0.2), (3, 1, 0)), repeats=((2, 0), (0, 3))
    )
    yarn = half[half.index("<Yarn") : half.index("</Textile>")]
    long = model('Periodic="1" type="CInterpolationLinear"', ((0, 0, 1), (4, 0, 1)), repeats=((4, 0), (0, 6)))
    textile = textile_from_xml(long.replace("</Textile>", yarn + "</Textile>"))
    assert textile.cell == pytest.approx((4000.0, 6000.0))
    low = [p for p in textile.paths if np.ptp(p.points[:, 2]) > 1.0]
    assert len(textile.paths) == 3 and len(low) == 2  # the short yarn twice across
    for path in low:
        assert path.points[[0, -1], 0] == pytest.approx([0.0, 4000.0])
        assert path.arc_length == pytest.approx(4.0 * np.hypot(1000.0, 200.0))
    assert sorted(p.points[0, 1] for p in low) == pytest.approx([1000.0, 4000.0])


def test_sections_become_ours():
    found = {}
    for section in (
        'type="CSectionEllipse" Width="0.2" Height="0.2"',
        'type="CSectionLenticular" Width="0.8" Height="0.2" Distortion="0"',
        'type="CSectionRectangle" Width="0.8" Height="0.2"',
        'type="CSectionPowerEllipse" Width="0.8" Height="0.2" Power="0.4"',
        'type="CSectionEllipse" Width="0.2" Height="0.8"',
    ):
        textile = textile_from_xml(model('Periodic="1" type="CInterpolationLinear"', NODES, section))
        found[section] = textile.paths[0], textile.notes
    paths, notes = zip(*found.values(), strict=True)
    assert [p.shape.section for p in paths] == ["circular", "lenticular", "rectangular", "racetrack", "elliptic"]
    assert all((p.shape.width, p.shape.thickness) == pytest.approx((800.0, 200.0)) for p in paths[1:])
    assert [len(n) for n in notes] == [0, 0, 0, 1, 0] and "taken as racetrack" in notes[3][0]
    # an upright section: its thickness lies across
    assert np.abs(paths[4].normal[:, 1]) == pytest.approx(1.0)


def test_what_cannot_be_read_is_refused(tmp_path):
    straight = 'Periodic="1" type="CInterpolationLinear"'
    ok = model(straight, NODES)
    textile_from_xml(ok)
    for text, match in (
        ("<TexGenModel>", "XML"),
        ("<TexGenModel />", "textiles"),
        (ok[: ok.index("<Yarn")] + "</Textile></TexGenModel>", "standard or full"),
        (ok.replace('GeometryScale="mm"', 'GeometryScale="inch"'), "GeometryScale"),
        (ok.replace("CInterpolationLinear", "CInterpolationAdjusted"), "slave nodes"),
        (ok.replace("CSectionEllipse", "CSectionHybrid"), "CSectionHybrid"),
        (ok.replace('Angle="0"', 'Angle="0.3"'), "turned"),
        (model(straight, NODES[:3]), "as long as its repeat"),
        (model(straight, NODES, repeats=((4, 0),)), "every yarn"),
    ):
        with pytest.raises(InputError, match=match):
            textile_from_xml(text)
    with pytest.raises(InputError, match="readable"):
        textile_from_file(tmp_path / "none.tg3")
    with pytest.raises(InputError, match="one of t"):
        textile_from_xml(ok, "other")
    open_yarn = textile_from_xml(model(straight, NODES, repeats=()))
    assert open_yarn.cell is None and not open_yarn.paths[0].closed


def test_without_pytexgen_the_refusal_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pytexgen", None)
    with pytest.raises(InputError, match="pip install pytexgen"):
        textile_from_object(object())


@pytest.mark.parametrize("kind", ["Bezier", "Cubic", "Linear"])
@pytest.mark.parametrize("periodic", [True, False])
def test_lines_are_those_of_pytexgen(kind, periodic):
    tg = pytest.importorskip("pytexgen")
    textile, yarn = tg.CTextile(), tg.CYarn()
    for node in ((0, 0, 0), (1, 0.1, 0.3), (2.5, 0, -0.2), (4, 0, 0)):
        yarn.AddNode(tg.CNode(tg.XYZ(*map(float, node))))
    yarn.AssignInterpolation(getattr(tg, f"CInterpolation{kind}")(periodic))
    yarn.AssignSection(tg.CYarnSectionConstant(tg.CSectionLenticular(0.8, 0.2)))
    yarn.AddRepeat(tg.XYZ(4.0, 0.0, 0.0))
    yarn.AddRepeat(tg.XYZ(0.0, 3.0, 0.0))
    yarn.SetResolution(40)
    textile.AddYarn(yarn)
    path = textile_from_object(textile).paths[0]
    nodes = textile.GetYarn(0).GetSlaveNodes(tg.CYarn.LINE)
    theirs = 1e3 * np.array([[n.GetPosition().x, n.GetPosition().y, n.GetPosition().z] for n in nodes])
    at = np.column_stack([np.interp(theirs[:, 0], path.points[:, 0], path.points[:, k]) for k in range(3)])
    off = at - theirs
    off[:, 1:] -= off[0, 1:]
    assert np.abs(off).max() < 0.02  # um: chords of both


def test_a_twill_of_pytexgen():
    tg = pytest.importorskip("pytexgen")
    weave = tg.CTextileWeave2D(4, 4, 1.0, 0.4, False)
    for i in range(4):
        for j in range(4):
            if (i - j) % 4 < 2:
                weave.SwapPosition(i, j)
    weave.SetYarnWidths(0.4)
    weave.AssignDefaultDomain()
    textile = textile_from_object(weave)
    assert textile.cell == pytest.approx((4000.0, 4000.0)) and len(textile.paths) == 8
    heights = np.array(
        [[np.interp(p.crossings[i], p.arc, p.points[:, 2]) for i in range(4)] for p in textile.paths if p.is_warp]
    )
    up = heights > 0.0
    # each warp over two and under two, one on from warp to warp
    assert all(sorted(row) == [False, False, True, True] for row in up.tolist())
    assert all((np.roll(up[0], k) == up[k]).all() for k in range(4)) or all(
        (np.roll(up[0], -k) == up[k]).all() for k in range(4)
    )
    tow = TowShape("elliptic", 400.0, 200.0)
    ours = weave_paths(replace(WeaveSpec(up.T, tow, tow, 1000.0, 1000.0)))
    for a, b in zip(textile.paths, ours, strict=True):
        axis = 0 if a.is_warp else 1
        u = np.linspace(0.0, 4000.0, 301)
        z, expected = (np.interp(u, p.points[:, axis], p.points[:, 2]) for p in (a, b))
        assert np.abs(z - expected).max() < 0.012 * 200.0
