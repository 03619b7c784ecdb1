"""What engines warn of themselves."""

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Every other warning is an error, as anywhere."""
    for of_engine in (
        # Ray Data, of its own settings.
        "ignore::DeprecationWarning:ray[.].*",
        # Spark, which is not asked for pandas.
        "ignore:PySpark does not yet fully support pandas.*:FutureWarning",
    ):
        config.addinivalue_line("filterwarnings", of_engine)
