"""The house's rules, as far as a machine can check them."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "gtsam_nav"
MODULES = sorted(PACKAGE.rglob("*.py"))

LAYERS = (
    {"cli"},
    {"cli_batch", "cli_evaluate", "cli_export", "cli_rerun", "cli_run"},
    {"tables", "terminal", "cli_options"},
    {"methods", "audit", "batch", "doctor", "rerun"},
    {"graph", "ekf", "evaluation", "readers", "writers", "preprocess", "simulation", "cards"}
    | {"config", "sonar", "registration", "odometry"},
    {"sensors"},
    {"solution"},
    {"trajectory"},
    {"mission"},
    {"pose_edges"},
    {"series"},
    {"settings", "frames", "errors", "lazy", "yaml_files", "card_lines"},
)
"""From the top down; a module imports from its own layer or a lower one."""

HEAVY = (
    *("gtsam", "numba", "matplotlib", "scipy", "open3d", "rosbags", "pymap3d", "kiss_icp"),
    *("dask", "distributed", "pandas", "pyarrow", "PIL"),
)
LONGEST_MODULE = 450
LONGEST_FUNCTION = 90
"""The aim is 350 and 50 lines; nothing may outgrow these."""


def layer_of(name: str) -> int:
    return next(k for k, layer in enumerate(LAYERS) if name in layer)


def area(module: Path) -> str:
    """Top-level name inside the package: gtsam_nav/ekf/x.py is 'ekf'."""
    return module.relative_to(PACKAGE).with_suffix("").parts[0]


@cache
def nodes(module: Path) -> tuple[ast.AST, ...]:
    """The syntax of a module, in all its parts."""
    return tuple(ast.walk(ast.parse(module.read_text(encoding="utf-8"))))


def imports(module: Path) -> Iterator[str]:
    """Dotted names that a module imports, wherever in the file."""
    for node in nodes(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def module_id(module: Path) -> str:
    return str(module.relative_to(ROOT))


@pytest.mark.parametrize("module", MODULES, ids=module_id)
def test_imports_run_downward(module: Path) -> None:
    if area(module) == "__init__":
        return
    own = layer_of(area(module))
    for name in imports(module):
        parts = name.split(".")
        if parts[0] == "gtsam_nav" and parts[1:] not in ([], ["__version__"]):
            assert layer_of(parts[1]) >= own, f"{module} imports {name}, which is above it"


def test_filters_and_graph_do_not_know_each_other() -> None:
    for module in MODULES:
        other = {"ekf": "gtsam_nav.graph", "graph": "gtsam_nav.ekf"}.get(area(module))
        if other is not None:
            assert [name for name in imports(module) if name.startswith(other)] == []


def test_only_the_graph_imports_gtsam() -> None:
    importers = {
        area(module)
        for module in MODULES
        if any(name.split(".")[0] == "gtsam" for name in imports(module))
    }
    assert importers <= {"graph"}


def test_only_the_command_line_prints() -> None:
    for module in MODULES:
        calls = {ast.unparse(node.func) for node in nodes(module) if isinstance(node, ast.Call)}
        printing = {"print", "typer.echo", "sys.stdout.write", "sys.exit"} & calls
        assert not printing or area(module) in {"cli", "terminal"}, (module, printing)


@pytest.mark.parametrize(
    "statement",
    [
        "import gtsam_nav",
        "import gtsam_nav.readers, gtsam_nav.methods, gtsam_nav.config",
        "from typer.testing import CliRunner\n"
        "from gtsam_nav.cli import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0",
    ],
    ids=["package", "library", "help"],
)
def test_heavy_packages_wait_until_they_are_used(statement: str) -> None:
    code = f"import sys\n{statement}\nprint(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in run.stdout.split()}
    assert loaded.isdisjoint(HEAVY)


def test_the_bare_package_imports_next_to_nothing() -> None:
    code = "import sys, gtsam_nav\nprint(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"numpy", "pydantic", "yaml"}.isdisjoint(run.stdout.split())


def test_public_names_stay_what_they_are() -> None:
    """No submodule takes the place of the function that has its name."""
    import gtsam_nav

    for module in MODULES:
        if area(module) not in {"__init__", "graph", "registration", "odometry"}:
            import_module(".".join(module.relative_to(ROOT).with_suffix("").parts))
    for name in gtsam_nav.__all__:
        assert callable(getattr(gtsam_nav, name)), name


@pytest.mark.parametrize("package", ["sensors", "registration", "sonar", "evaluation"])
def test_data_of_the_estimation_core_is_frozen(package: str) -> None:
    for path in sorted((PACKAGE / package).glob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = import_module(".".join(parts).removesuffix(".__init__"))
        for name, data in vars(module).items():
            if isinstance(data, type) and is_dataclass(data):
                assert data.__dataclass_params__.frozen, f"{module.__name__}.{name}"


@pytest.mark.parametrize("module", MODULES, ids=module_id)
def test_modules_and_functions_stay_small(module: Path) -> None:
    source = module.read_text(encoding="utf-8")
    assert source.count("\n") <= LONGEST_MODULE
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            documented = ast.get_docstring(node, clean=False) or ""
            lines = (node.end_lineno or 0) - node.lineno - documented.count("\n")
            assert lines <= LONGEST_FUNCTION, f"{module}:{node.lineno} {node.name}"


def test_no_module_is_a_drawer() -> None:
    drawers = {"utils", "util", "helpers", "helper", "manager", "common", "misc"}
    assert drawers.isdisjoint(module.stem for module in MODULES)


def test_committed_files_name_no_package_index() -> None:
    """An install must work from whatever index the user's pip is set to."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert "pyproject.toml" in listed
    index = re.compile(r"--(extra-)?index-url|--find-links|pypi\.org/simple|/simple/")
    for name in listed:
        path = ROOT / name
        if path == Path(__file__) or path.suffix in {".png", ".npz", ".gz"} or not path.is_file():
            continue
        assert not index.search(path.read_text(encoding="utf-8")), name
