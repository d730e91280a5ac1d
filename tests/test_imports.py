"""What is imported when: help and wrong usage need next to nothing, shading and fitting little."""

import subprocess
import sys
from pathlib import Path

import pytest

STANDARD = ("asyncio", "dataclasses", "email", "inspect", "socket", "subprocess", "tempfile")
STANDARD += ("traceback", "typing_extensions", "unittest")
"""Modules of Python that take longer than all of the help."""
ARRAYS = ("jax", "jaxlib", "numpy", "equinox", "jaxtyping")
FILES = ("scipy", "trimesh", "embreex", "imageio", "imagecodecs", "OpenEXR", "rawpy", "PIL")
SOLVERS = ("optimistix", "lineax")
OTHERS = ("matplotlib", "IPython", "beartype", "colour", "torch", "drjit", "lmfit", "optax")
OTHERS += ("tqdm",)


def imported(code: str, *names: str) -> set[str]:
    """Which of these modules a fresh process has after this code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys\nprint('\\n', *sys.modules)"],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return set(names) & set(done.stdout.splitlines()[-1].split())


def test_what_is_imported_is_seen() -> None:
    assert imported("import numpy, socket", *STANDARD, *ARRAYS) >= {"numpy", "socket"}


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("--help", 0),
        ("demo --help", 0),
        ("render --help", 0),
        ("view --help", 0),
        ("fit --help", 0),
        ("evaluate --help", 0),
        ("export --help", 0),
        ("calibrate --help", 0),
        ("", 2),
        ("fit x --bogus", 2),
        ("fit x --circle 1,2", 2),
        ("export x --to mtl", 2),
    ],
)
def test_help_and_wrong_usage_import_nothing_heavy(words: str, status: int) -> None:
    code = f"from diffshade.cli import run; assert run({words.split()}) == {status}"
    assert imported(code, *STANDARD, *ARRAYS, *FILES, *SOLVERS, *OTHERS) == set()


def test_the_packages_alone_import_no_arrays() -> None:
    heavy = (*ARRAYS, *FILES, *SOLVERS, *OTHERS)
    assert imported("import diffshade, fitting; dir(diffshade), dir(fitting)", *heavy) == set()


@pytest.mark.parametrize(
    "names",
    [
        "diffshade.render",
        "diffshade.mean_squared_error, diffshade.Mesh, diffshade.gbuffer, diffshade.load_mesh",
        "fitting.fit",
    ],
)
def test_names_import_no_files_and_no_solvers(names: str) -> None:
    found = imported(f"import diffshade, fitting; {names}", "jax", *FILES, *SOLVERS, *OTHERS)
    assert found == {"jax"}


def test_maps_import_their_solver_and_no_files() -> None:
    found = imported("import fitting; fitting.fit_maps, fitting.solve", *FILES, *SOLVERS, *OTHERS)
    assert found == set(SOLVERS)


def test_tables_of_colours_change_nothing_for_others() -> None:
    """colour-science would filter warnings, and print arrays its own way, in the whole process."""
    code = """
import warnings, numpy
import diffshade.colour.observer as observer
before = list(warnings.filters), numpy.get_printoptions()
observer.standard_observer(numpy.array([555.0]))
assert (list(warnings.filters), numpy.get_printoptions()) == before
"""
    assert imported(code, "colour") == {"colour"}
    assert imported("import diffshade.colour.metamer, diffshade.colour.munsell", "colour") == set()
