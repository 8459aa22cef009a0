"""What all tests share: one BLAS thread, repeatable random examples, and the three mechanisms."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import mechanisms
import pytest
from hypothesis import settings

settings.register_profile("planner", deadline=None, max_examples=12, derandomize=True)
settings.load_profile("planner")


@pytest.fixture(scope="session")
def human_arms() -> mechanisms.Mechanism:
    """The paper's arms: two joints each, hinged together at the object."""
    return mechanisms.settle(mechanisms.human_arms())


@pytest.fixture(scope="session")
def three_jointed(tmp_path_factory: pytest.TempPathFactory) -> mechanisms.Mechanism:
    """Planar arms with three joints each, hinged together: redundant."""
    folder = tmp_path_factory.mktemp("three_jointed")
    return mechanisms.settle(mechanisms.planar_arms(folder, "revolute"))


@pytest.fixture(scope="session")
def three_jointed_rigid(tmp_path_factory: pytest.TempPathFactory) -> mechanisms.Mechanism:
    """Planar arms with three joints each that both hold the object firmly."""
    folder = tmp_path_factory.mktemp("three_jointed_rigid")
    return mechanisms.settle(mechanisms.planar_arms(folder, "rigid"))


@pytest.fixture(scope="session")
def pandas() -> mechanisms.Mechanism:
    """Two Pandas with seven joints each that both hold a point mass firmly, under gravity."""
    return mechanisms.settle(mechanisms.pandas())


@pytest.fixture(
    scope="session",
    params=["human_arms", "three_jointed", "three_jointed_rigid", "pandas"],
)
def mechanism(request: pytest.FixtureRequest) -> mechanisms.Mechanism:
    """Each of the four in turn."""
    chosen: mechanisms.Mechanism = request.getfixturevalue(request.param)
    return chosen
