"""All of these tests run for longer than they compile."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def long_runs(optimised):
    pass
