"""How every test runs: strictly, in float64 unless the float32 pass is asked for, with printed seeds.

python -m pytest                   everything, float64
python -m pytest --precision 32    the tests that hold in float32
"""

import os

# As the command line has it: XLA complains of every program that it finds in its cache on processors
# whose flags hold preferences of the compiler (openxla/xla issue 44565). It is read with JAX's import.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

import jax
import numpy as np
import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--precision", choices=("32", "64"), default="64", help="bits of a float")


def pytest_configure(config: pytest.Config) -> None:
    jax.config.update("jax_enable_x64", config.getoption("--precision") == "64")
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")
    # Compiling takes most of the time of a fit: programs are kept from run to run.
    assert config.cache is not None
    jax.config.update("jax_compilation_cache_dir", str(config.cache.mkdir("jax")))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
    # Commands that tests start run at the same precision, and share one cache of compiled programs.
    os.environ["JAX_ENABLE_X64"] = str(config.getoption("--precision") == "64")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--precision") == "64":
        return
    skip = pytest.mark.skip(reason="holds in float64 only")
    for item in items:
        if item.get_closest_marker("float64"):
            item.add_marker(skip)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers from a seed that is printed when the test fails."""
    seed = int.from_bytes(request.node.nodeid.encode()[-8:], "little")
    print(f"seed {seed}")
    return np.random.default_rng(seed)


@pytest.fixture
def tolerance() -> float:
    """What rounding may cost: relative, after a few hundred operations."""
    return 1e-12 if jax.config.jax_enable_x64 else 2e-5
